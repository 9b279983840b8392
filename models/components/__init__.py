"""Small circuits that show the components of the library at work, some of one family in each."""
