"""`armtrue open`: the workbench, a page on this machine that adds effects to the model and shows how the error changes.

No physics and no statistics are here: fits and diagnoses are the library's, charts and tables are the report's.

    opening → session (a tree of models on disk) → engine (one action at a time) → view → server → browser
"""
