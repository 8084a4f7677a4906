"""What arguments may be: numbers, whole numbers, words, flags, vectors, kinds.

Each function returns what it was given, as the type that it stands for, or raises a
`ValueError` whose message begins with the name of the argument and says value and cure.
Text is no number, and neither is True. Numbers that are traced have no value yet and
pass.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Collection, Iterable, Sequence
from typing import Any

import numpy as np
from jax.core import Tracer

#: Kinds of NumPy's types that are real numbers.
REAL = "fiu"


def _wanted(above: float, least: float, below: float, most: float) -> str:
    """A range in words."""
    low, high = max(above, least), min(below, most)
    if math.isfinite(low) and math.isfinite(high):
        return f"lie between {low:g} and {high:g}"
    if math.isfinite(high):
        return f"be a number {'below' if below <= most else 'at most'} {high:g}"
    if low == 0:
        return "be positive" if above == 0 else "not be negative"
    if math.isfinite(low):
        return f"be a number {'above' if above >= least else 'at least'} {low:g}"
    return "be a number"


def real(value: Any) -> Any:
    """The numbers as an array, or None if they are none: text, True, None, objects."""
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        return None
    return array if array.dtype.kind in REAL else None


def numbers(
    name: str,
    value: Any,
    *,
    above: float = -math.inf,
    least: float = -math.inf,
    below: float = math.inf,
    most: float = math.inf,
    endless: bool = False,
    cure: str = "",
) -> Any:
    """One number or an array of numbers, all finite and in a range.

    Args:
        name: of the argument.
        value: what was given; returned as it is.
        above: all must be above it.
        least: all must be at least that.
        below: all must be below it.
        most: all must be at most that.
        endless: whether infinity is allowed.
        cure: what is said beside the range: unit, default, a common value.

    Raises:
        ValueError: naming the argument.
    """
    if isinstance(value, Tracer):
        return value
    array = real(value)
    if array is not None and array.size:
        good = ~np.isnan(array) if endless else np.isfinite(array)
        good &= (array >= least) & (array <= most)
        good &= (array > above) | (above == -math.inf)
        good &= (array < below) | (below == math.inf)
        if good.all():
            return value
    wanted = _wanted(above, least, below, most)
    wanted += "" if endless or "lie" in wanted else ", and finite"
    if array is None and "number" not in wanted:
        wanted += ", a number"
    raise ValueError(f"{name}: {value!r} must {wanted}{cure and '; ' + cure}")


def number(name: str, value: Any, **limits: Any) -> Any:
    """One finite number in a range; see `numbers`.

    Raises:
        ValueError: naming the argument.
    """
    if not isinstance(value, Tracer):
        array = real(value)
        if array is not None and array.ndim:
            raise ValueError(f"{name}: {value!r} must be a single number")
    return numbers(name, value, **limits)


def positive(**values: Any) -> None:
    """Single numbers above 0, by name.

    Raises:
        ValueError: naming the first that is none.
    """
    for name, value in values.items():
        number(name, value, above=0)


def whole(name: str, value: Any, least: int = 1, cure: str = "") -> int:
    """A whole number, at least `least`; 3.0 is one.

    Raises:
        ValueError: naming the argument.
    """
    array: Any = real(value)
    if array is not None and not array.ndim and np.isfinite(array):
        integer = float(array).is_integer()
        if integer and array >= least:
            return int(array)
    more = f"; {cure}" if cure else ""
    raise ValueError(
        f"{name}: {value!r} must be a whole number, at least {least}{more}"
    )


def word(name: str, value: Any, known: Collection[str], cure: str = "") -> str:
    """One of some words.

    Raises:
        ValueError: naming the argument and the words.
    """
    if not (isinstance(value, str) and value in known):
        more = f"; {cure}" if cure else ""
        raise ValueError(f"{name}: {value!r} must be one of {tuple(known)}{more}")
    return value


def near(name: str, known: Iterable[str]) -> str:
    """A hint at the known name that is nearest, "did you mean 'x'? ", or nothing."""
    found = difflib.get_close_matches(name, list(known), 1, 0.5)
    return f"did you mean {found[0]!r}? " if found else ""


def option(name: str, known: Collection[str], what: str) -> None:
    """Refuse an option that something does not have, with the nearest that it has.

    Raises:
        ValueError: naming the option.
    """
    if name not in known:
        hint = near(name, known)
        raise ValueError(f"{name}: is no option of {what}; {hint}they are {[*known]}")


def flag(name: str, value: Any) -> bool:
    """True or False.

    Raises:
        ValueError: naming the argument.
    """
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name}: {value!r} must be True or False")
    return bool(value)


def vector(
    name: str, value: Any, sizes: Sequence[int] = (1, 2, 3), endless: bool = False
) -> tuple[float, ...]:
    """A point or a vector of one of some sizes, all finite.

    Raises:
        ValueError: naming the argument.
    """
    array = real(value)
    good = array is not None and array.ndim == 1 and len(array) in sizes
    if array is None or not good:
        some = " or ".join(map(str, sizes))
        raise ValueError(f"{name}: {value!r} must be {some} numbers, as a tuple")
    numbers(name, value, endless=endless)
    return tuple(map(float, array))


def instance(name: str, value: Any, of: Any, cure: str) -> Any:
    """An object of a type.

    Raises:
        ValueError: naming the argument.
    """
    if not isinstance(value, of):
        raise ValueError(f"{name}: {value!r} must be {cure}")
    return value
