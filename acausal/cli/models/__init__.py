"""Commands about models: list, describe and check them, print their equations."""
