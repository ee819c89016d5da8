"""The sections of the page, in files by what they tell of."""
