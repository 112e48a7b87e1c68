"""Time on air of radio packets, by kind of radio, as measured on robots of the league.

**wifi-broadcast.** An access point holds packets to all stations until its beacon, and then sends
them in a burst. On a robot of the team ibis, commands sent every 15 ms arrived at intervals with
the median 1.136 ms, the 99th percentile 96.8 ms, and the maximum 198.2 ms; 13 of 667 were lost and
20 overwritten. The maximum is two beacon intervals less a burst, and 13 packets are two bursts: so
bursts are lost as a whole.

**wifi-unicast.** The same commands to the address of one robot: median 15.000 ms, 99th percentile
16.244 ms, maximum 16.528 ms, none lost. The sum of two uniformly distributed waits (for the channel
and for the program) has the last two percentiles.

**time-slots.** A base station with the transceiver SX1280 sends to one robot after the other, about
one per millisecond for up to 16 robots (RoboTeam Twente; TIGERs Mannheim have slots for up to 12).
It holds the newest command of each robot until its slot.

Sources: ibis-ssl/Orion_CM4 doc/timing_investigation_20260920.md;
wiki.roboteamtwente.nl/technical/embedded/basestation; TIGERs-Mannheim/Firmware radio_base.c.
"""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config import PERIOD_S
from omni_mj.config.network_settings import (
    BURST_SPACING_S,
    BURST_SPACING_SIGMA,
    RadioSettings,
)
from omni_mj.config.settings import gather
from omni_mj.network.random_streams import Noise, Seed, Stream


class AirTime:
    """Time on air of packets to n robots.

    Robots of a world share the access point or the base station, which has its own clock.

    Args:
        settings: Settings of each row.
        seeds: Seed of each row.
    """

    def __init__(self, settings: Sequence[RadioSettings], seeds: Sequence[Seed]) -> None:
        kinds = np.array([row.kind for row in settings])
        self._is_broadcast = kinds == "wifi-broadcast"
        self._is_unicast = kinds == "wifi-unicast"
        self._has_slots = kinds == "time-slots"
        self._is_fixed = bool((kinds == "fixed").all())
        shared_seeds = [
            seed if kind == "wifi-unicast" else seed[:1]
            for kind, seed in zip(kinds, seeds, strict=True)
        ]
        self._uniform_noise = Noise(shared_seeds, Stream.RADIO_AIR, 2)
        self._normal_noise = Noise(shared_seeds, Stream.RADIO_AIR, 1, "standard_normal")
        phase = Noise(shared_seeds, Stream.RADIO_PHASE).next()[:, 0]
        slot = np.array([seed[1] if len(seed) > 1 else 0 for seed in seeds])
        self._interval_s = np.where(
            self._is_broadcast,
            gather(settings, "beacon_interval_s"),
            gather(settings, "slot_cycle_s"),
        )
        # Time of a beacon or of the robot's slot
        slot_start_s = slot * gather(settings, "slot_s")
        self._first_s = phase * self._interval_s + np.where(self._has_slots, slot_start_s, 0.0)
        self._max_s = PERIOD_S * gather(settings, "max_air_frames")
        self._access_delay_s = gather(settings, "access_delay_s")
        self._burst_loss_probability = gather(settings, "burst_loss_probability")
        self._burst = np.full(len(seeds), -np.inf)  # number of the beacon of the latest burst
        self._queue_end_s = np.full(len(seeds), -np.inf)  # when the latest packet arrives
        self._burst_is_lost = np.zeros(len(seeds), bool)

    def send(self, time: float, is_sent: np.ndarray) -> tuple[Array, np.ndarray]:
        """Send packets.

        Args:
            time: Time of sending, s, not before that of the previous call.
            is_sent: Robots to which a packet is sent, (n,).

        Returns:
            Times on air (n,), s, and whether the packets are lost (n,).
        """
        if self._is_fixed:
            return np.zeros(len(is_sent)), np.zeros(len(is_sent), bool)
        uniform, normal = self._uniform_noise.next(), self._normal_noise.next()[:, 0]
        beacon = np.ceil((time - self._first_s) / self._interval_s)
        wait_s = self._first_s + beacon * self._interval_s - time
        begins_burst = is_sent & (beacon > self._burst)
        is_lost = uniform[:, 0] < self._burst_loss_probability
        self._burst_is_lost = np.where(begins_burst, is_lost, self._burst_is_lost)
        spacing_s = BURST_SPACING_S * np.exp(BURST_SPACING_SIGMA * normal)
        queue_end_s = np.where(begins_burst, time + wait_s, self._queue_end_s + spacing_s)
        self._queue_end_s = np.where(is_sent, queue_end_s, self._queue_end_s)
        self._burst = np.where(is_sent, beacon, self._burst)
        air_s = np.where(self._has_slots, wait_s, 0.0)
        air_s = np.where(self._is_unicast, self._access_delay_s * uniform.sum(1), air_s)
        air_s = np.where(self._is_broadcast, queue_end_s - time, air_s)
        return np.minimum(air_s, self._max_s), self._is_broadcast & self._burst_is_lost
