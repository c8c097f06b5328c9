# SPDX-License-Identifier: Apache-2.0
"""When a transform is sent that others may send, too."""
import itertools

import numpy as np
import pytest

from dbscan_reg_ros.node.frames.right_of_way import DISCOVERY, LISTEN, LONGEST, WAIT, RightOfWay, State


def alone():
    return None


def sending(now=0.0):
    right = RightOfWay()
    assert right.may_send(now, alone)
    return right


def taken_over(right, start, step=0.01):
    """Time at which ours is sent, if no transform of another node is received from `start` on."""
    return next(now for k in itertools.count() if right.take_over(now := start + k * step))


def test_one_that_is_alone_sends_at_once():
    assert sending().state is State.SENDING


@pytest.mark.parametrize('first', [0, 1, 3])
def test_one_that_may_not_be_alone_listens_first_the_longer_the_more_go_first(first):
    right = RightOfWay()
    assert not right.may_send(10.0, lambda: first)
    assert not right.may_send(10.0 + LISTEN * (1 + first) - 0.01, lambda: first)
    assert right.may_send(10.0 + LISTEN * (1 + first), lambda: first)


def test_one_stray_transform_takes_five_seconds_and_no_more():
    right = sending()
    right.conflict(1.0)
    assert right.gives_way and not right.may_send(5.9, alone)
    assert taken_over(right, 1.0) == pytest.approx(1.0 + WAIT, abs=0.02)
    assert not right.may_send(1.0 + WAIT + 0.5 * DISCOVERY, alone)
    assert right.may_send(1.1 + WAIT + DISCOVERY, alone)


def test_a_continuing_publisher_keeps_the_right_of_way():
    right = sending()
    for now in np.arange(1.0, 200.0, 4.9):
        right.conflict(now)
        assert not right.take_over(now + 4.8)
    assert right.wait == WAIT
    assert taken_over(right, now) == pytest.approx(now + WAIT, abs=0.02)


def test_the_waiting_time_doubles_each_time_up_to_80_s():
    right, now, waits = sending(), 1.0, []
    for _ in range(7):
        right.conflict(now)
        back = taken_over(right, now)
        waits.append(back - now)
        assert right.may_send(back + 1.0, alone)
        now = back + 2.0
    assert waits == pytest.approx([5.0, 10.0, 20.0, 40.0, 80.0, 80.0, 80.0], abs=0.02)


def test_after_a_long_time_undisturbed_it_waits_for_five_seconds_again():
    right = sending()
    for now, wait in ((1.0, 5.0), (10.0, 10.0), (22.0 + LONGEST, 5.0)):
        right.conflict(now)
        assert right.wait == wait
        assert right.may_send(taken_over(right, now) + 1.0, alone)


def test_who_insists_sends_at_once_and_waits_for_five_seconds_the_next_time():
    right = sending()
    for now in (1.0, 10.0):
        right.conflict(now)
        right.insist(now + 1.0)
        assert right.may_send(now + 1.0, lambda: 2)
    right.conflict(20.0)
    assert right.wait == WAIT


def simulated(seed, duration=120.0):
    """Which of two equal nodes sends the transform of each scan: a list of (time, senders).

    Both receive the same scans, at 10 Hz with a pause, and check the graph once a second, each with its own phase. Both
    start at once before they have discovered each other, so that both send at first.
    """
    rng = np.random.default_rng(seed)
    rights, phases, announced = [RightOfWay(), RightOfWay()], rng.uniform(0.0, 1.0, 2), [0.0, 0.0]
    pause = rng.uniform(0.0, duration)
    sent = []
    for now in np.arange(0.0, duration, 0.01):
        for k in np.flatnonzero(np.floor(now - phases) > np.floor(now - 0.01 - phases)):
            if rights[k].take_over(now):
                announced[k] = now
        if round(now * 100) % 10 or pause < now < pause + 12.0:
            continue
        knows = [now > announced[1 - k] + 0.05 and now > 0.1 and not rights[1 - k].gives_way for k in (0, 1)]
        who = [k for k in (0, 1) if rights[k].may_send(now, lambda first=k if knows[k] else None: first)]
        for k in who:
            rights[1 - k].conflict(now + 0.02)
        sent.append((now, who))
    return sent


@pytest.mark.parametrize('seed', range(20))
def test_two_like_nodes_never_both_send_and_change_at_most_three_times_in_a_minute(seed):
    sent = simulated(seed)
    both = [now for now, who in sent if len(who) == 2]
    assert len(both) <= 1 and all(now < 0.1 for now in both)
    senders = [who[0] for _, who in sent if len(who) == 1]
    assert np.count_nonzero(np.diff(senders)) <= 3
    assert len(senders) > 0.9 * (len(sent) - 65)
