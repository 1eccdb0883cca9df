"""Errors that a user can act on: which file or layer, what was expected, what to do."""


class SvbrdfError(Exception):
    """Base of every error that this suite raises on purpose; users are shown its text as it is."""


class MissingStageError(SvbrdfError):
    """A filter needs the result of another filter that has not run on this project."""


class DocumentError(SvbrdfError):
    """A file of the project is missing, unreadable or not what its name says."""
