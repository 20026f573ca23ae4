"""Flags of a step: what went wrong in it."""

from enum import IntFlag


class Flags(IntFlag):
    """What went wrong in a step; a step without a flag has the value 0.

    The members have the names and bits of the page "Flags and events" of the book, which gives the remedies.
    """

    not_converged = 1
    """The solver did not converge, so forces and displacements are less exact than was requested."""
    region_overflow = 2
    """There are more contact patches than there is room for, so some contacts are missing."""
    contact_overflow = 4
    """There are more contacts than there is room for; the deepest are kept."""
    depth_beyond_limit = 8
    """Skin lies deeper in another body than ``contact.depth_limit``."""
    not_a_height_field = 16
    """A skin folds over itself where it is touched, so the depth of contact is ambiguous."""
    non_finite = 32
    """The solution contained a number that is not finite and was rejected."""
    step_retried = 64
    """The step failed and was done in two, four or eight shorter steps instead."""
    frozen = 128
    """The step failed however short it was made: everything that moves by itself was stopped."""
    adhesive_dropped_twice = 256
    """Some contacts still pull after the last release, so the force may be a little too small."""
    turns_too_far = 512
    """A body turned so far within a step that it may gain energy."""
    inverted = 1024
    """A tetrahedron was inverted, or pressed so flat that its rotation was not found."""
    newton_not_converged = 2048
    """After all Newton iterations of the step its equations were not solved."""
    moved_too_far = 4096
    """The tool moved further than its own extent in a step near a body, which it may have passed through."""
