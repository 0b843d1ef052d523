"""Ties and loops: what makes any layered depth map close."""

from __future__ import annotations

from itertools import product

import pytest

from surface.lattice import PARTS, RIMS, Matching, loops, matchings


@pytest.mark.parametrize(("parts", "others"), list(product(range(PARTS + 1), repeat=2)))
def test_every_matching_ties_each_node_once_to_one_of_its_facing(parts: int, others: int) -> None:
    found = matchings(parts, others)
    assert len(set(found)) == len(found) > 0
    for matching in found:
        ours = [i for i, _ in matching.across] + [k for i in matching.rims[0] for k in (i, i + 1)]
        theirs = [j for _, j in matching.across] + [k for j in matching.rims[1] for k in (j, j + 1)]
        assert sorted(ours) == list(range(2 * parts))
        assert sorted(theirs) == list(range(2 * others))
        assert all(i % 2 == j % 2 for i, j in matching.across)
        assert list(matching.across) == sorted(matching.across, key=lambda tie: tie[1])


def test_one_part_beside_one_is_joined_or_apart() -> None:
    assert set(matchings(1, 1)) == {
        Matching(((0, 0), (1, 1)), ((), ())),
        Matching((), ((0,), (0,))),
    }


def test_a_part_beside_two_ends_a_part_or_the_gap() -> None:
    joined = {m for m in matchings(1, 2) if m.across}
    assert joined == {
        Matching(((0, 0), (1, 1)), ((), (2,))),  # the far part ends
        Matching(((0, 2), (1, 3)), ((), (0,))),  # the near part ends
        Matching(((0, 0), (1, 3)), ((), (1,))),  # the gap ends
    }


def test_turned_twice_it_is_itself_and_turned_once_one_of_the_others() -> None:
    for i, j in product(range(1, PARTS + 1), repeat=2):
        for matching in matchings(i, j):
            assert matching.turned() in matchings(j, i)
            assert matching.turned().turned() == matching


@pytest.mark.parametrize("parts", list(product((0, 1, 2), repeat=4)))
def test_the_loops_of_a_cell_take_each_node_once_and_each_rim_from_both_sides(
    parts: tuple[int, ...],
) -> None:
    """All kinds of cells with up to two parts at each corner."""
    choices = [range(len(matchings(parts[c], parts[(c + 1) % 4]))) for c in range(4)]
    for ties in product(*choices):
        found = loops(parts, ties)
        nodes = [node for loop in found for chain in loop.chains for node in chain]
        assert len(nodes) == len(set(nodes)) == 2 * sum(parts)
        for loop in found:
            if not loop.rims:
                continue
            assert len(loop.rims) == len(loop.chains)
            assert len(loop.rims) % 2 == 0
            for k, (chain, rim) in enumerate(zip(loop.chains, loop.rims, strict=True)):
                assert {node.kind % 2 for node in chain} == {k % 2}
                assert rim.falling == (k % 2 == 0)
                assert chain[-1].corner == rim.corner
                assert chain[-1].kind == RIMS[rim.pair][0 if rim.falling else 1]
        rims = [rim for loop in found for rim in loop.rims]
        tied = sum(
            len(side)
            for c in range(4)
            for side in matchings(parts[c], parts[(c + 1) % 4])[ties[c]].rims
        )
        assert len(rims) == len(set(rims)) == tied
