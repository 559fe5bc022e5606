import numpy as np
import pytest

from humanoid_sim.simulation.batch.draws import normals, philox, seed_keys, uniforms, uniforms_of_streams

FULL = 0xFFFFFFFF


@pytest.mark.parametrize(
    ("counter", "key", "expected"),
    [
        ([0, 0, 0, 0], [0, 0], [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]),
        ([FULL] * 4, [FULL] * 2, [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD]),
        (
            [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344],
            [0xA4093822, 0x299F31D0],
            [0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1],
        ),
    ],
)
def test_known_answers_of_the_authors(counter, key, expected):
    """`kat_vectors` of Random123."""
    words = philox(np.array(counter, dtype=np.uint64)[:, None], np.array(key, dtype=np.uint64)[:, None])
    assert words[:, 0].tolist() == expected


def counters(*values):
    return np.array(values, dtype=np.int64)


def test_an_environment_draws_the_same_in_any_batch():
    many = normals(seed_keys([5, 6, 7]), 3, counters(10, 11, 12), 9)
    alone = normals(seed_keys([6]), 3, counters(11), 9)
    np.testing.assert_array_equal(many[1:2], alone)
    wider = normals(seed_keys([6]), 3, counters(11), 10)
    assert wider.shape == (1, 10)


def test_seed_stream_and_counter_each_change_everything():
    first = uniforms(seed_keys([1]), 1, counters(1), 64)[0]
    others = [
        uniforms(seed_keys([2]), 1, counters(1), 64)[0],
        uniforms(seed_keys([1 + 2**32]), 1, counters(1), 64)[0],
        uniforms(seed_keys([1]), 2, counters(1), 64)[0],
        uniforms(seed_keys([1]), 1, counters(2), 64)[0],
        uniforms(seed_keys([1]), 1, counters(1 + 2**32), 64)[0],
    ]
    for other in others:
        assert not np.isin(other, first).any()
        assert abs(np.corrcoef(first, other)[0, 1]) < 0.4


def test_distributions():
    keys, steps = seed_keys(np.arange(500)), np.arange(500)
    uniform = uniforms(keys, 0, steps, 200)
    assert 0.0 < uniform.min() < 1e-4
    assert 1.0 - 1e-4 < uniform.max() < 1.0
    assert uniform.mean() == pytest.approx(0.5, abs=0.005)
    normal = normals(keys, 0, steps, 201)
    assert normal.shape == (500, 201)
    assert normal.mean() == pytest.approx(0.0, abs=0.01)
    assert normal.std() == pytest.approx(1.0, abs=0.01)
    assert (normal**4).mean() == pytest.approx(3.0, abs=0.1)
    assert np.abs(np.corrcoef(normal, rowvar=False) - np.eye(201)).max() < 0.3


def test_several_streams_at_once_are_those_of_each():
    keys, counter = seed_keys([5, 2**40]), np.array([7, 3 << 32])
    together = uniforms_of_streams(keys, [(1, 5), (9, 1), (3, 8)], counter)
    for (stream, width), found in zip([(1, 5), (9, 1), (3, 8)], together, strict=True):
        np.testing.assert_array_equal(found, uniforms(keys, stream, counter, width))
        assert found.shape == (2, width)
