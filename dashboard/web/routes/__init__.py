"""The requests that the page answers, one module a subject."""
