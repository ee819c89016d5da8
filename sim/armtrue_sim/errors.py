"""The one exception that callers of the simulator need to know."""


class ScenarioError(ValueError):
    """A scenario that cannot be simulated.

    Its text is one sentence for a person: the file, the key, what was found and what was expected.
    """
