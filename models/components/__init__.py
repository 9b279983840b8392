"""Small models that demonstrate the components of the library, one file for each family."""
