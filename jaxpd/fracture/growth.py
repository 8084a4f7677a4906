"""What a slow fracture leaves behind: `Growth`."""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jaxpd import io
from jaxpd._types import PointVector
from jaxpd.fracture.breaking import Fracture, piece_labels
from jaxpd.fracture.retrace import Retrace
from jaxpd.fracture.soft_replay import SoftReplay, replay_of
from jaxpd.fracture.soft_states import Softened
from jaxpd.fracture.states import NEVER
from jaxpd.geometry import Region
from jaxpd.operators.springs import Springs
from jaxpd.scene import Scene


class Unfinished(RuntimeError):
    """A fracture that did not come to its end; the message says where and why."""


@dataclass(frozen=True, eq=False)
class Growth:
    """States in equilibrium of a body that breaks slowly; leading axis [F].

    The first state is at rest. Between two states the bonds that go fade in proportion
    to the way; see `jaxpd.fracture.states` for what that makes of work and release.

    Attributes:
        scene: what broke.
        fracture: what it was prepared into.
        springs: its bonds, on the host.
        factor: load factor [F] (-).
        force: work of the factor's growth by 1 [F] (J): reactions times prescribed
            displacements, and loads times displacements, those at the factor 1.
        pull: loads at the factor 1 times displacements [F] (J).
        critical: bond that stands at its strength in each state [F]; -1 where none
            does.
        accepted: states in which no bond stands above its strength [F]; the others are
            passes on the way to one, at the same factor.
        held: numbers of the supported points [q].
        reaction: forces of the supports on them [F, q, d] (N).
        watched: mean displacements in the regions asked for [F, w, d] (m).
        stored: energy of all bonds [F] (J).
        work: of supports and loads since rest [F] (J).
        released: lost with bonds [F] (J): what they held, and what their loss frees.
        bonds: what the broken bonds held when they went [F] (J).
        broken_at: state from which on each bond is gone [b]: -1 by the scene's cracks,
            F of those whose loss tore a piece off, `states.NEVER` if it stands.
        u: displacements in the last state [n, d] (m).
        floppy: points that could move without any force [n]: pieces that came off, and
            hinges. They are held so that no force arises; where they are means nothing.
            Of the direct solver and brittle bonds alone; `pieces` always tells.
        cost: of each state [F], by name: "solves", "iterations", "factorisations",
            "seconds".
        fallbacks: how often each way out was needed, by name.
        stopped: why it ended.
        done: whether that is an end that was asked for.
        seconds: wall time of "prepare" and "path".
        peak_memory: highest resident memory of the process so far (bytes).
        softened: memory and displacements of every state, if bonds soften; a bond is
            broken when nothing of its force is left.
    """

    scene: Scene
    fracture: Fracture
    springs: Springs
    factor: np.ndarray
    force: np.ndarray
    pull: np.ndarray
    critical: np.ndarray
    accepted: np.ndarray
    held: np.ndarray
    reaction: np.ndarray
    watched: np.ndarray
    stored: np.ndarray
    work: np.ndarray
    released: np.ndarray
    bonds: np.ndarray
    broken_at: np.ndarray
    u: PointVector
    floppy: np.ndarray
    cost: dict[str, np.ndarray]
    fallbacks: dict[str, int]
    stopped: str
    done: bool
    seconds: dict[str, float]
    peak_memory: int
    softened: Softened | None = None

    def __repr__(self) -> str:
        """One line: sizes, balance, end."""
        return (
            f"Growth({len(self.X)} points, {len(self.factor)} states, "
            f"{int(self.broken.sum())} bonds broken, energy balance "
            f"{np.abs(self.balance).max():.1e}, {self.stopped})"
        )

    @property
    def X(self) -> PointVector:
        """Reference positions [n, d] (m)."""
        return np.asarray(self.fracture.X)

    @property
    def broken(self) -> np.ndarray:
        """Bonds that broke, cracks of the scene aside [b]."""
        return (self.broken_at >= 0) & (self.broken_at < NEVER)

    @property
    def balance(self) -> np.ndarray:
        """Work less stored and released energy, over the largest work so far [F]."""
        left = self.work - self.stored - self.released
        scale = np.maximum.accumulate(np.abs(self.work))
        return left / np.where(scale > 0.0, scale, 1.0)

    @property
    def envelope(self) -> np.ndarray:
        """Numbers of the states that monotone loading sees: the factor's new maxima."""
        seen = np.where(self.accepted, self.factor, -np.inf)
        before = np.concatenate([[-np.inf], np.maximum.accumulate(seen)[:-1]])
        return np.flatnonzero(seen > before)

    @property
    def jumps(self) -> list[dict[str, float]]:
        """What each unstable event sets free under monotone loading.

        A jump starts at a state of the envelope where the factor falls after it, and
        ends where it is exceeded, or at the end of a body that is severed or torn; of
        load steps it is all that breaks at one factor. Dictionaries of "state",
        "factor", "broken" bonds, "released" (J) on the way, and "surplus" (J): with
        supports and loads held at that factor, what the body gives beyond that, and
        motion takes; inf where a load goes on pulling at a piece.
        """
        found, torn = [], self.stopped.startswith("torn")
        last = len(self.factor) - 1
        for a, b in self._ways():
            away = torn and b == last
            # at the factor of a the body ends in the state b, scaled back
            f = self.factor[a]
            share = f / self.factor[b]
            gone = self.released[b] - self.released[a]
            # the last way is taken back to that factor, and what fades on it
            gone -= (1.0 - share) * (self.released[b] - self.released[b - 1])
            fell = self.stored[a] - self.stored[b] * share**2
            fell -= f * (self.pull[a] - self.pull[b] * share)
            found.append(
                {
                    "state": int(a),
                    "factor": float(f),
                    "broken": int(((self.broken_at > a) & (self.broken_at <= b)).sum()),
                    "released": float(gone),
                    "surplus": np.inf if away else float(fell - gone),
                }
            )
        return found

    def _ways(self) -> list[tuple[int, int]]:
        """First and last states of each jump."""
        if self.softened is None and not (self.critical >= 0).any():
            # load steps: all passes at one factor
            new = np.flatnonzero(np.diff(self.factor, prepend=-np.inf, append=np.inf))
            pairs = [(int(a), int(b) - 1) for a, b in itertools.pairwise(new)]
            return [(a, b) for a, b in pairs if b > a]
        states, last = self.envelope.tolist(), len(self.factor) - 1
        if self.stopped.startswith(("severed", "torn")) and states[-1] < last:
            states.append(last)
        return [(a, b) for a, b in itertools.pairwise(states) if b > a + 1]

    def broken_by(self, state: int = -1) -> np.ndarray:
        """Mask of the bonds that are gone in a state [b], cracks of the scene too."""
        return self.broken_at <= range(len(self.factor))[state]

    def damage(self, state: int = -1, precracks: bool = False) -> np.ndarray:
        """Damage index [n] (-), the lost share of the bonds of each point.

        Args:
            state: which one.
            precracks: count bonds that cracks of the scene cut.
        """
        s, n = self.springs, len(self.X)
        start = np.ones(len(s.k), bool) if precracks else self.broken_at >= 0
        share = np.asarray(s.k * s.length)  # weights of PMB bonds: their volumes

        def total(mask):
            value = np.where(mask, share, 0.0)
            ends = np.bincount(s.i, value, n) + np.bincount(s.j, value, n)
            return ends

        whole = total(start)
        if self.softened is not None:
            share = share * self.softened.share(state, len(share))
        left = total(start & ~self.broken_by(state))
        return 1.0 - np.divide(left, whole, out=np.ones(n), where=whole > 0)

    def places(self, state: int = -1) -> np.ndarray:
        """Middles of the bonds that broke up to a state [c, d] (m), in their order."""
        some = np.flatnonzero((self.broken_at >= 0) & self.broken_by(state))
        some = some[np.argsort(self.broken_at[some], kind="stable")]
        return 0.5 * (self.X[self.springs.i[some]] + self.X[self.springs.j[some]])

    def pieces(self, state: int | None = None) -> np.ndarray:
        """Label of the piece that each point belongs to [n].

        Args:
            state: in which; None is at the end, with the bonds that tore a piece off.
        """
        live = self.broken_at == NEVER if state is None else ~self.broken_by(state)
        s = self.springs
        return piece_labels(s.i[live], s.j[live], len(self.X))

    def reaction_on(self, region: Region) -> np.ndarray:
        """Resultants [F, d] (N) of the supports' forces on the points in a region."""
        return self.reaction[:, region.contains(self.X[self.held])].sum(axis=1)

    @functools.cached_property
    def peak(self) -> int:
        """Number of the state of the highest load that monotone loading sees.

        Of supports that move the one with the largest `force`; with loads the one with
        the largest factor.
        """
        states = self.envelope
        load = self.factor if np.any(self.pull) else self.force
        return int(states[np.argmax(load[states])])

    def replay(self, kept: Any = None) -> Retrace | SoftReplay:
        """States as one differentiable function of the parameters.

        Args:
            kept: their numbers; by default those of the envelope, of softening bonds
                all but rest.

        Raises:
            ValueError: on a state at rest, or one that does not exist.
        """
        if self.softened is not None:
            return replay_of(self.fracture, self.softened, self.factor, kept)
        numbers = self.envelope[1:] if kept is None else np.atleast_1d(kept)
        numbers = np.array([range(len(self.factor))[int(k)] for k in numbers])
        if not len(numbers) or not (self.factor[numbers] > 0).all():
            raise ValueError(f"kept: {kept} must name states under load")
        gone = self.broken_at[None] <= numbers[:, None]
        at = (self.critical[numbers], self.factor[numbers])
        return Retrace(self.fracture, gone, *at)

    def checked(self) -> Growth:
        """This, if it came to an end that was asked for.

        Raises:
            Unfinished: saying where it stopped, and why.
        """
        if not self.done:
            raise Unfinished(
                f"stopped after {len(self.factor)} states at the load factor "
                f"{self.factor[-1]:.6g}: {self.stopped}"
            )
        return self

    def write(self, folder: str | Path) -> list[Path]:
        """A VTU file of the last state, and a .pvd that names it; needs meshio."""
        fields = {
            "u": self.u[None],
            "damage": self.damage(precracks=True)[None],
            "piece": self.pieces()[None].astype(float),
        }
        return io.write_series(folder, self.X, self.factor[-1:], fields)
