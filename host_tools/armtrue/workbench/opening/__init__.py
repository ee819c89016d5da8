"""From files, dropped or named, to measurements with an arm and a model."""
