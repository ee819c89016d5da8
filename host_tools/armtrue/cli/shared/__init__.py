"""Code that several commands share: options, output, reading and printing of fits, diagnoses and tables."""
