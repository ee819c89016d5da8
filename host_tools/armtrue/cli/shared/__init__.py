"""What several commands share: options, output, reading and showing of fits, diagnoses and tables."""
