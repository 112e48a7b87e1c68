"""Model of the radio link: commands arrive after a dead time, with jitter, losses and faults."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config import CYCLES_PER_FRAME, FRAME_RATE_HZ
from omni_mj.config.faults import (
    Fault,
    RadioBurstLoss,
    RadioDelay,
    RadioDuplicates,
    RadioLoss,
    RadioReorder,
)
from omni_mj.config.network_settings import RadioSettings
from omni_mj.config.settings import gather
from omni_mj.network.air_time import AirTime
from omni_mj.network.fault_schedule import FaultsByRow, FaultSchedule
from omni_mj.network.random_streams import Noise, Seed, Stream, continue_bursts


class ReceivedCommand(NamedTuple):
    """The command that each of n robots applies in a frame.

    Attributes:
        command: Newest command that has arrived, (n, 3); zero before the first. If commands arrive
            within the frame, their mean over the frame.
        heading: Heading from vision that was sent with it, (n,) rad; NaN if nothing new arrived.
        age: Frames since that heading was sent, (n,).
        is_new: Whether it arrived in this frame, (n,). Default: all did.
        in_body_frame: Whether its velocities are in the robot's frame, (n,). Default: none are.
        rim_speeds: Commanded rim speeds in place of a velocity, (n, wheels) m/s; NaN for a
            velocity. Default: all are velocities.
        segments: First cycle of each segment of the frame, and the commands that apply from then
            on, if dead times are not whole frames. Default: commands apply in the whole frame.
    """

    command: Array
    heading: Array
    age: np.ndarray
    is_new: np.ndarray | None = None
    in_body_frame: np.ndarray | None = None
    rim_speeds: Array | None = None
    segments: "tuple[tuple[int, ReceivedCommand], ...]" = ()

    def split(self) -> "Iterator[tuple[int, ReceivedCommand]]":
        """Yield the number of cycles of each segment, and the commands that apply in them."""
        segments = self.segments or ((0, self),)
        for (start, segment), (end, _) in pairwise([*segments, (CYCLES_PER_FRAME, self)]):
            yield end - start, segment


def compute_max_delay_frames(settings: RadioSettings, faults: Sequence[Fault]) -> int:
    """Return the longest time that a packet can take, rounded up to whole frames."""
    delays = [settings.delay_frames, *_list_fault_delays(faults, RadioDelay)]
    extra_delays = [0.0, *_list_fault_delays(faults, RadioDuplicates, RadioReorder)]
    return math.ceil(
        max(delays) + settings.jitter_frames + max(extra_delays) + settings.max_air_frames
    )


def needs_cycles(settings: RadioSettings, faults: Sequence[Fault]) -> bool:
    """Return whether packets may arrive within a frame."""
    delays = _list_fault_delays(faults, RadioDelay, RadioDuplicates, RadioReorder)
    delays += settings.delay_frames, settings.jitter_frames
    return settings.kind != "fixed" or any(delay % 1 for delay in delays)


def _list_fault_delays(faults: Sequence[Fault], *kinds: type[Fault]) -> list[float]:
    return [dict(fault)["delay_frames"] for fault in faults if isinstance(fault, kinds)]


class _Delivery(NamedTuple):
    """Packets that arrive in the same tick.

    Attributes:
        sent_tick: Tick in which they were sent.
        robots: Indices of the receiving robots, (k,).
        packets: Contents, (k, columns).
        is_last: Whether they arrive after all others of their tick, even after newer ones.
    """

    sent_tick: int
    robots: np.ndarray
    packets: Array
    is_last: bool


class Radio:
    """Link to n robots. A packet holds a command and the latest heading from vision.

    With a delay of 2 frames, sending a, b, c, d in frames 0 to 3 delivers the initial packet twice,
    then a and b. With jitter a packet may overtake another. Of the packets that have arrived, a
    robot applies the one that was sent last. If a packet is lost, the robot keeps the previous
    one.

    The fault `radio-delay` sets the dead time of packets sent while it is active; of several such
    faults the last one counts. Other faults lose packets, deliver them after newer ones, or deliver
    them twice. A robot applies such a packet until the next one arrives. Each packet is subject to
    each kind of fault independently. Several faults of the same kind multiply the probabilities
    that a packet passes.

    A frame consists of ticks. Delays are rounded to ticks. The simulated loop sends to all robots
    once a frame (`exchange`). Other callers `send` to some robots any number of times per tick,
    then `deliver` once.

    Args:
        settings: Dead time, jitter and losses of each row.
        seeds: Seed of each row; rows with the same seed lose the same packets.
        faults: Faults of each row. Default: none.
        ticks_per_frame: Number of ticks per frame.
        initial_packet: Contents that robots hold before the first packet, (columns,).
        jitters_by_tick: Whether any jitter is a number of ticks. Default: jitter of whole frames is
            a number of frames.
    """

    def __init__(
        self,
        settings: Sequence[RadioSettings],
        seeds: Sequence[Seed],
        faults: FaultsByRow = (),
        ticks_per_frame: int = 1,
        initial_packet: Sequence[float] = (0.0, 0.0, 0.0, np.nan),
        *,
        jitters_by_tick: bool = False,
    ) -> None:
        n = len(seeds)
        self._ticks_per_frame, self._tick = ticks_per_frame, 0
        self._jitters_by_tick = jitters_by_tick
        self._air_time = AirTime(settings, seeds)
        # Drawn for each packet or frame, also without faults, so that a fault does not affect
        # another.
        self._jitter_noise = Noise(seeds, Stream.RADIO_JITTER)
        self._loss_noise = Noise(seeds, Stream.RADIO_LOSSES)
        self._burst_noise = Noise(seeds, Stream.RADIO_BURSTS)
        self._fault_noise = Noise(seeds, Stream.RADIO_FAULTS, 4)
        self._burst_pass_probability = np.ones(n)  # that a packet passes the bursts
        # Active bursts, and whether each is in its lossy state.
        self._burst_states = dict[tuple[int, RadioBurstLoss], bool]()
        self._packets = np.tile(np.asarray(initial_packet, float), (n, 1))
        self._sent_ticks = np.full(n, -1)  # of the packets that robots hold
        self._newest_sent_ticks = np.full(n, -1)  # without duplicates and late packets
        # By tick of arrival, in the order of sending.
        self._deliveries = dict[int, list[_Delivery]]()
        # Headings that arrived within the previous frame, NaN if none, and their ages in frames
        self._late_headings, self._late_ages = np.full(n, np.nan), np.zeros(n, int)
        self.change_settings(settings, faults)
        self._begin_frame()

    def can_change(self, settings: RadioSettings, faults: Sequence[Fault]) -> bool:
        """Return whether frames have the ticks that settings and faults of a row need."""
        return self._ticks_per_frame > 1 or not needs_cycles(settings, faults)

    def change_settings(self, settings: Sequence[RadioSettings], faults: FaultsByRow = ()) -> None:
        """Change dead time, jitter, losses and faults of packets sent from now on.

        Times on air do not change. Delays are rounded to the ticks of the radio.

        Args:
            settings: Settings of each row.
            faults: Faults of each row. Default: none.
        """
        self._nominal_delay = self._to_ticks(gather(settings, "delay_frames"))
        jitter_frames = gather(settings, "jitter_frames")
        is_in_ticks = self._jitters_by_tick | (jitter_frames % 1 > 0)
        self._jitter_step = np.where(is_in_ticks, 1, self._ticks_per_frame)  # ticks
        self._jitter = self._to_ticks(jitter_frames) // self._jitter_step
        self._loss_probability = gather(settings, "loss_probability")
        self._schedule = FaultSchedule(faults)
        self._schedule.advance(self._tick // self._ticks_per_frame)
        self._apply_faults()

    def exchange(self, command: Array, heading: Array) -> ReceivedCommand:
        """Send commands (n, 3) and headings (n,); return the commands applied in this frame.

        Headings that arrive within a frame are returned in the next frame.
        """
        packets = np.empty((len(command), 4))
        packets[:, :3], packets[:, 3] = command, heading
        self.send(packets)
        packets, is_new, age = self.deliver()
        packets[~is_new, 3] = np.nan
        initial = ReceivedCommand(
            packets[:, :3], packets[:, 3], age // self._ticks_per_frame, is_new
        )
        return initial if self._ticks_per_frame == 1 else self._receive_rest_of_frame(initial)

    def _receive_rest_of_frame(self, initial: ReceivedCommand) -> ReceivedCommand:
        """Return the commands of a frame whose first tick has ended.

        Args:
            initial: Commands at the beginning of the frame.
        """
        is_missing = np.isnan(initial.heading)
        initial = initial._replace(
            heading=np.where(is_missing, self._late_headings, initial.heading),
            age=np.where(is_missing, self._late_ages, initial.age),
        )
        self._late_headings = np.full_like(self._late_headings, np.nan)
        segments, mean, no_heading = [(0, initial)], initial.command, self._late_headings
        for tick in range(1, self._ticks_per_frame):
            packets, is_new, age = self.deliver()
            if not is_new.any():
                continue
            segment = ReceivedCommand(packets[:, :3], no_heading, age, is_new)
            segments.append((tick * CYCLES_PER_FRAME // self._ticks_per_frame, segment))
            # The change of the command acts in the rest of the frame.
            change = segment.command - segments[-2][1].command
            mean = mean + (1 - tick / self._ticks_per_frame) * change
            frames = -(-age // self._ticks_per_frame)
            self._late_headings = np.where(is_new, packets[:, 3], self._late_headings)
            self._late_ages = np.where(is_new, frames, self._late_ages)
        return initial._replace(command=mean, segments=tuple(segments))

    def send(self, packets: Array, robots: np.ndarray | None = None) -> None:
        """Send packets.

        Args:
            packets: Contents for all n robots, (n, columns).
            robots: Indices of the receiving robots. Default: all.
        """
        is_sent = np.full(len(self._sent_ticks), robots is None)
        if robots is not None:
            is_sent[robots] = True
        # Rounded: integers from -jitter to jitter, all with the same probability.
        jitter = (2 * self._jitter + 1) * self._jitter_noise.next()[:, 0] - (self._jitter + 0.5)
        tick_rate_hz = FRAME_RATE_HZ * self._ticks_per_frame
        air_time, is_lost_on_air = self._air_time.send(self._tick / tick_rate_hz, is_sent)
        arrival = self._tick + self._delay + np.rint(jitter).astype(int) * self._jitter_step
        arrival += np.rint(air_time * tick_rate_hz).astype(int)
        loss, burst, duplicate, reorder = self._fault_noise.next().T
        is_received = is_sent & (self._loss_noise.next()[:, 0] >= self._loss_probability)
        is_received &= loss < self._loss_pass_probability
        is_received &= ~is_lost_on_air
        is_received &= burst < self._burst_pass_probability
        is_late = is_received & (reorder < self._reorder_probability)
        is_duplicated = is_received & (duplicate < self._duplicate_probability)
        extra_frames = np.where(is_late, self._reorder_frames, self._duplicate_frames)
        late_arrival = arrival + self._to_ticks(extra_frames)
        self._schedule_delivery(packets, is_late | is_duplicated, late_arrival, is_last=True)
        self._schedule_delivery(packets, is_received & ~is_late, arrival, is_last=False)

    def deliver(self) -> tuple[Array, np.ndarray, np.ndarray]:
        """End a tick.

        Returns:
            Packets that the robots hold (n, columns), whether they arrived in this tick (n,), and
            their ages in ticks (n,).
        """
        tick, is_new = self._tick, np.zeros(len(self._sent_ticks), bool)
        deliveries = self._deliveries.pop(tick, [])
        for delivery in sorted(deliveries, key=lambda delivery: delivery.is_last):
            robots, packets = delivery.robots, delivery.packets
            if not delivery.is_last:
                is_newer = self._newest_sent_ticks[robots] <= delivery.sent_tick
                robots, packets = robots[is_newer], packets[is_newer]
                self._newest_sent_ticks[robots] = delivery.sent_tick
            self._packets[robots] = packets
            self._sent_ticks[robots] = delivery.sent_tick
            is_new[robots] = True
        self._tick += 1
        if self._tick % self._ticks_per_frame == 0:
            self._begin_frame()
        return self._packets.copy(), is_new, tick - self._sent_ticks

    def _to_ticks(self, frames: Array | float) -> np.ndarray:
        """Return times in frames as the nearest numbers of ticks."""
        return np.rint(np.asarray(frames, float) * self._ticks_per_frame).astype(int)

    def _schedule_delivery(
        self, packets: Array, mask: np.ndarray, arrival: np.ndarray, is_last: bool
    ) -> None:
        """Schedule packets (n, columns) of the robots in `mask` (n,) at ticks `arrival` (n,)."""
        while np.count_nonzero(mask):
            tick = int(arrival[mask][0])
            robots = np.flatnonzero(mask & (arrival == tick))
            self._deliveries.setdefault(tick, []).append(
                _Delivery(self._tick, robots, packets[robots], is_last)
            )
            mask = mask & (arrival != tick)

    def _begin_frame(self) -> None:
        """Apply the faults of the frame that begins."""
        if self._schedule.advance(self._tick // self._ticks_per_frame):
            self._apply_faults()
        uniform = self._burst_noise.next()[:, 0]
        self._burst_pass_probability[:] = 1.0
        for (row, bursts), is_lossy in self._burst_states.items():
            is_lossy = bool(
                continue_bursts(
                    is_lossy, bursts.mean_burst_frames, bursts.burst_fraction, uniform[row]
                )
            )
            self._burst_states[row, bursts] = is_lossy
            self._burst_pass_probability[row] *= 1 - bursts.probability * is_lossy

    def _apply_faults(self) -> None:
        """Set delays and probabilities to those of the active faults."""
        n = len(self._nominal_delay)
        self._delay = self._nominal_delay.copy()  # of packets sent from now on, ticks
        self._loss_pass_probability = np.ones(n)  # that a packet passes the losses
        # Probabilities of duplicates and of late packets, and their additional frames.
        self._duplicate_probability, self._reorder_probability = np.zeros((2, n))
        self._duplicate_frames, self._reorder_frames = np.zeros((2, n))
        for row, delay in self._schedule.list_active(RadioDelay):
            self._delay[row] = self._to_ticks(delay.delay_frames)
        for row, loss in self._schedule.list_active(RadioLoss):
            self._loss_pass_probability[row] *= 1 - loss.probability
        for row, duplicates in self._schedule.list_active(RadioDuplicates):
            self._duplicate_probability[row] = duplicates.probability
            self._duplicate_frames[row] = duplicates.delay_frames
        for row, reorder in self._schedule.list_active(RadioReorder):
            self._reorder_probability[row] = reorder.probability
            self._reorder_frames[row] = reorder.delay_frames
        self._burst_states = {
            burst: self._burst_states.get(burst, False)
            for burst in self._schedule.list_active(RadioBurstLoss)
        }
