"""Guarantees of the radio model for any sender and any receiver."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby

import pytest
from hypothesis import given
from hypothesis import strategies as st
from profiles import full_only

from swarmctl.bus.radio import (
    MAX_WAIT_S,
    LossReason,
    Partition,
    Radio,
    RadioSettings,
    RadioSilence,
    gilbert_probabilities,
)
from swarmctl.config.communication import Communication
from swarmctl.config.radio import radio_settings
from swarmctl.core.geo import distance_m

Sent = tuple[int, int, int, float]
"""Sender, receiver, bytes, seconds since the previous message."""

UAVS = st.integers(1, 4)
SENT = st.lists(st.tuples(UAVS, UAVS, st.integers(1, 3000), st.floats(0.0, 2.0)), max_size=60)


def outcomes(radio: Radio, sent: Sequence[Sent]) -> list[tuple[Sent, float, float | LossReason]]:
    """Send the messages; return each with its time [s] and its outcome."""
    now_s, found = 0.0, []
    for message in sent:
        sender, to, n_bytes, later_s = message
        now_s += later_s
        found.append((message, now_s, radio.send(sender, to, n_bytes, now_s)))
    return found


def lost_of(radio: Radio, n: int) -> list[bool]:
    return [radio.send(1, 2, 100, float(i)) is LossReason.LOSS for i in range(n)]


def is_reached(radio: Radio, sender: int, to: int, now_s: float = 0.0) -> bool:
    return not isinstance(radio.send(sender, to, 100, now_s), LossReason)


def test_a_radio_with_defaults_is_transparent() -> None:
    radio = Radio(RadioSettings(), seed=1)
    assert radio.is_transparent
    assert radio.send(1, 2, 10**9, 7.25) == 7.25
    assert radio.distance_loss((46.0, 14.0), (-46.0, -14.0)) is None


@pytest.mark.parametrize(
    "settings",
    [
        RadioSettings(delay_s=0.1),
        RadioSettings(quiet=(RadioSilence(frozenset({1})),)),
    ],
)
def test_a_radio_with_any_setting_is_not_transparent(settings: RadioSettings) -> None:
    assert not Radio(settings, seed=1).is_transparent


@given(SENT, st.floats(0.0, 3.0), st.floats(0.0, 3.0), st.sampled_from([math.inf, 500.0, 2000.0]))
def test_a_message_arrives_after_its_delay(
    sent: list[Sent], delay_s: float, jitter_s: float, bandwidth_bytes_s: float
) -> None:
    settings = RadioSettings(
        delay_s=delay_s, jitter_s=jitter_s, loss=0.2, bandwidth_bytes_s=bandwidth_bytes_s
    )
    for (_, _, n_bytes, _), now_s, arrives_s in outcomes(Radio(settings, seed=5), sent):
        if not isinstance(arrives_s, LossReason):
            needs_s = n_bytes / bandwidth_bytes_s
            assert arrives_s >= now_s + delay_s
            assert arrives_s >= now_s + needs_s + delay_s - 1e-9
            assert arrives_s <= now_s + MAX_WAIT_S + needs_s + delay_s + jitter_s + 1e-9


def test_jitter_is_uniform_and_reorders() -> None:
    radio = Radio(RadioSettings(delay_s=1.0, jitter_s=0.5), seed=4)
    later_s = [float(radio.send(1, 2, 100, 0.0)) - 1.0 for _ in range(20_000)]
    assert min(later_s) >= 0.0
    assert max(later_s) <= 0.5
    for quarter in range(4):
        share = sum(0.125 * quarter <= s < 0.125 * (quarter + 1) for s in later_s) / len(later_s)
        assert share == pytest.approx(0.25, abs=0.02)
    assert later_s != sorted(later_s)


def test_other_seeds_and_pairs_have_other_outcomes() -> None:
    pairs = ((1, 2), (2, 1), (1, 3), (12, 1))
    radios = [Radio(RadioSettings(loss=0.5), seed) for seed in (1, 2)]
    met = {tuple(radio.send(*pair, 1, 0.0) for _ in range(60)) for radio in radios for pair in pairs}
    assert len(met) == len(radios) * len(pairs)


@given(SENT, st.sampled_from([None, 3.0]))
def test_the_outcomes_of_a_pair_do_not_depend_on_others(sent: list[Sent], burst: float | None) -> None:
    settings = RadioSettings(jitter_s=1.0, loss=0.4, loss_burst=burst)
    together = outcomes(Radio(settings, 7), sent)
    for sender, to in {(m[0], m[1]) for m in sent}:
        alone = Radio(settings, 7)
        for (its_sender, its_to, n_bytes, _), now_s, outcome in together:
            if (its_sender, its_to) == (sender, to):
                assert alone.send(sender, to, n_bytes, now_s) == outcome


@pytest.mark.parametrize(
    "also",
    [
        RadioSettings(loss=0.3, quiet=(RadioSilence(frozenset({1}), 10.0, 20.0),)),
        RadioSettings(loss=0.3, partitions=(Partition((frozenset({1}),), 10.0, 20.0),)),
        RadioSettings(loss=0.3, jitter_s=0.5),
        RadioSettings(loss=0.3, bandwidth_bytes_s=90.0),
    ],
)
def test_additional_causes_of_loss_do_not_change_the_outcomes_of_other_messages(also: RadioSettings) -> None:
    plain, other = Radio(RadioSettings(loss=0.3), 3), Radio(also, 3)
    other_found = [other.send(1, 2, 100, float(i)) for i in range(200)]
    for is_lost, found in zip(lost_of(plain, 200), other_found, strict=True):
        assert is_lost == (found is LossReason.LOSS) or found in (
            LossReason.QUIET,
            LossReason.PARTITION,
            LossReason.BANDWIDTH,
        )


@pytest.mark.parametrize("seed", [1, *full_only(2)])
@pytest.mark.parametrize(
    ("loss", "loss_burst", "mean_burst"),
    [(0.3, None, 1 / 0.7), (0.3, 1.0, 1.0), (0.9, 9.0, 9.0), (0.1, 10.0, 10.0)],
)
def test_the_share_and_the_bursts_of_losses_are_as_configured(
    loss: float, loss_burst: float | None, mean_burst: float, seed: int
) -> None:
    lost = lost_of(Radio(RadioSettings(loss=loss, loss_burst=loss_burst), seed), 200_000)
    assert sum(lost) / len(lost) == pytest.approx(loss, rel=0.1)
    bursts = [sum(1 for _ in run) for is_lost, run in groupby(lost) if is_lost]
    assert sum(bursts) / len(bursts) == pytest.approx(mean_burst, rel=0.1)


def test_the_first_message_has_the_same_loss_probability() -> None:
    settings = RadioSettings(loss=0.25, loss_burst=10.0)
    first = [Radio(settings, seed).send(1, 2, 1, 0.0) is LossReason.LOSS for seed in range(4000)]
    assert sum(first) / len(first) == pytest.approx(0.25, abs=0.03)


@given(st.floats(0.0, 0.99), st.floats(1.0, 100.0))
def test_gilberts_probabilities_give_the_share_and_the_burst(loss: float, burst: float) -> None:
    try:
        p_enter, p_stay = gilbert_probabilities(loss, burst)
    except ValueError:
        assert burst < loss / (1.0 - loss)
        return
    assert 0.0 <= p_enter <= 1.0
    assert 1.0 / (1.0 - p_stay) == pytest.approx(burst)
    assert p_enter / (p_enter + 1.0 - p_stay) == pytest.approx(loss, abs=1e-9)


def test_impossible_bursts_are_refused_with_the_limit() -> None:
    with pytest.raises(ValueError, match=r"0\.9\b.*\b9\b"):
        RadioSettings(loss=0.9, loss_burst=1.0)
    assert RadioSettings(loss=0.9, loss_burst=9.0).loss_burst == 9.0
    with pytest.raises(ValueError, match=r"\b0 .*\b1"):
        RadioSettings(loss=1.0)


@given(SENT)
def test_a_transmitter_never_exceeds_its_bandwidth(sent: list[Sent]) -> None:
    # All messages that arrive after a and until b were on the air in that time.
    found = outcomes(Radio(RadioSettings(bandwidth_bytes_s=1000.0, delay_s=0.5), 1), sent)
    for sender in {m[0] for m in sent}:
        left = [(s, m[2]) for m, _, s in found if m[0] == sender and not isinstance(s, LossReason)]
        assert left == sorted(left)
        for i, (a, _) in enumerate(left):
            n_bytes = 0
            for b, its_bytes in left[i + 1 :]:
                n_bytes += its_bytes
                assert n_bytes <= 1000.0 * (b - a) + 1e-6


def test_a_transmitter_queues_messages_and_drops_those_that_wait_too_long() -> None:
    radio = Radio(RadioSettings(bandwidth_bytes_s=100.0, delay_s=0.25), 1)
    assert radio.send(1, 2, 100, 0.0) == 1.25
    assert radio.send(1, 3, 100, 0.0) == 2.25  # for any receiver
    assert radio.send(2, 3, 100, 0.0) == 1.25  # the transmitter of another UAV is free
    assert radio.send(1, 2, 50, 0.0) == 2.75  # waits 2 s, the limit
    assert radio.send(1, 2, 1, 0.0) is LossReason.BANDWIDTH
    assert radio.send(1, 2, 50, 0.5) == 3.25
    assert radio.send(1, 2, 100, 60.0) == 61.25


def test_a_silent_uav_sends_nothing_and_still_receives() -> None:
    settings = RadioSettings(bandwidth_bytes_s=100.0, quiet=(RadioSilence(frozenset({1, 3}), 5.0, 6.0),))
    radio = Radio(settings, 1)
    assert radio.send(1, 2, 100, 4.0) == 5.0
    assert radio.send(1, 2, 100, 5.0) is LossReason.QUIET
    assert radio.send(3, 2, 100, 5.999) is LossReason.QUIET
    assert radio.send(2, 1, 100, 5.5) == 6.5
    assert radio.send(1, 2, 100, 6.0) == 7.0


def test_a_partition_passes_messages_within_a_group() -> None:
    groups = (frozenset({1, 2}), frozenset({3, 4}))
    radio = Radio(RadioSettings(partitions=(Partition(groups, 10.0, 20.0),)), 1)
    for now_s in (0.0, 9.999, 20.0):
        assert all(is_reached(radio, a, b, now_s) for a in range(1, 6) for b in range(1, 6))
    for now_s in (10.0, 19.999):
        reached = {
            (a, b) for a in range(1, 6) for b in range(1, 6) if a != b and is_reached(radio, a, b, now_s)
        }
        assert reached == {(1, 2), (2, 1), (3, 4), (4, 3)}
    assert radio.send(1, 3, 100, 15.0) is LossReason.PARTITION


def test_a_message_passes_only_if_all_partitions_allow_it() -> None:
    one = Partition((frozenset({1, 2, 3}), frozenset({4})), 0.0, 10.0)
    two = Partition((frozenset({1}), frozenset({2, 3, 4})), 5.0, 15.0)
    radio = Radio(RadioSettings(partitions=(one, two)), 1)

    def to(now_s: float) -> list[tuple[int, int]]:
        return [(a, b) for a in range(1, 5) for b in range(a + 1, 5) if is_reached(radio, a, b, now_s)]

    assert to(0.0) == [(1, 2), (1, 3), (2, 3)]
    assert to(5.0) == [(2, 3)]
    assert to(10.0) == [(2, 3), (2, 4), (3, 4)]
    assert len(to(15.0)) == 6


# On the equator a degree of longitude is 111 319.49 m.
@pytest.mark.parametrize(
    ("lon_deg", "found"),
    [
        (0.0, LossReason.TOO_NEAR),
        (0.00089, LossReason.TOO_NEAR),
        (0.0009, None),
        (0.0044, None),
        (0.0045, LossReason.TOO_FAR),
        (90.0, LossReason.TOO_FAR),
    ],
)
def test_uavs_receive_each_other_only_within_the_distance_limits(
    lon_deg: float, found: LossReason | None
) -> None:
    radio = Radio(RadioSettings(min_distance_m=100.0, max_distance_m=500.0), 1)
    assert radio.distance_loss((0.0, 0.0), (0.0, lon_deg)) is found


def test_uavs_exactly_at_a_limit_receive_each_other() -> None:
    here, there = (46.0, 14.0), (46.001, 14.002)
    apart_m = distance_m(here, there)
    for settings in (RadioSettings(min_distance_m=apart_m), RadioSettings(max_distance_m=apart_m)):
        assert Radio(settings, 1).distance_loss(here, there) is None


def test_a_uav_at_an_unknown_position_is_received() -> None:
    radio = Radio(RadioSettings(min_distance_m=100.0, max_distance_m=500.0), 1)
    assert radio.distance_loss(None, (0.0, 0.0)) is None
    assert radio.distance_loss((0.0, 0.0), None) is None
    assert radio.distance_loss(None, None) is None


NAMES = {1: "alpha", 2: "beta", 7: "gamma"}


def test_an_empty_section_is_a_transparent_radio() -> None:
    assert Radio(radio_settings(Communication(), NAMES), 1).is_transparent


def test_a_section_configures_the_radio_by_names_or_system_ids() -> None:
    section = Communication.model_validate_json(
        '{"delay_s": 0.1, "jitter_s": 0.2, "loss": 0.3, "loss_burst": 4, "bandwidth_bytes_s": 5000,'
        '"max_distance_m": 600, "min_distance_m": 70,'
        '"partitions": [{"from_s": 8, "until_s": 9, "groups": [["alpha", 7], ["2"]]},'
        '{"from_s": 10, "groups": [["beta"]]}], "quiet": [{"uavs": ["gamma"]}]}'
    )
    assert radio_settings(section, NAMES) == RadioSettings(
        delay_s=0.1,
        jitter_s=0.2,
        loss=0.3,
        loss_burst=4.0,
        bandwidth_bytes_s=5000.0,
        max_distance_m=600.0,
        min_distance_m=70.0,
        partitions=(
            Partition((frozenset({1, 7}), frozenset({2})), 8.0, 9.0),
            Partition((frozenset({2}),), 10.0),
        ),
        quiet=(RadioSilence(frozenset({7})),),
    )
