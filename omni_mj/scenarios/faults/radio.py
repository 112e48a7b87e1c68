"""What happens to the radio: its packets are late, lost, doubled, or overtaken by others."""

from typing import TYPE_CHECKING, Literal

from omni_mj.scenarios.checking import setting
from omni_mj.scenarios.faults.base import Fault, chance

if TYPE_CHECKING:
    from omni_mj.scenarios.settings import Settings


class Delay(Fault):
    """Another dead time of what is sent from then on; the team is not told."""

    says = "dead time of {to} frames"

    kind: Literal["delay"] = setting("delay", "", "another dead time of the radio, which the team is not told")
    to: int = setting(..., "frames", "dead time, in place of radio.delay_frames", 0, 600)

    def refused(self, settings: "Settings") -> str:
        """See `Fault`: no packet arrives before it is sent."""
        jitter = settings.radio.jitter_frames
        return f"to must not be below radio.jitter_frames, {jitter}, but is {self.to}" if self.to < jitter else ""


class RadioLoss(Fault):
    """Packets that are lost, each by itself."""

    says = "radio that loses {probability:g} of the packets"

    kind: Literal["radio-loss"] = setting("radio-loss", "", "packets are lost, each by itself")
    probability: float = chance("that a packet never arrives, beside radio.loss_probability")


class RadioBursts(Fault):
    """Packets that are lost in bursts: the channel of Gilbert (1960) and Elliott (1963).

    A Markov chain steps from frame to frame between a state in which nothing is lost, in which it begins, and one in
    which packets are.
    """

    says = "radio with bursts of {frames:g} frames, {share:g} of the time"

    kind: Literal["radio-bursts"] = setting("radio-bursts", "", "packets are lost in bursts (Gilbert, Elliott)")
    frames: float = setting(..., "frames", "how long a burst lasts, on average", 1, 600)
    share: float = setting(..., "", "of the time that is in bursts, in the long run", 0.001, 0.5)
    probability: float = chance("that a packet of a burst is lost", 1.0)


class RadioDuplicates(Fault):
    """Packets that come twice; a robot cannot tell a copy from a new packet, and obeys it until the next comes."""

    says = "radio that brings {probability:g} of the packets again after {frames} frames"

    kind: Literal["radio-duplicates"] = setting(
        "radio-duplicates", "", "packets come twice, and robots obey the copy until the next packet"
    )
    probability: float = chance("that a packet comes again")
    frames: int = setting(..., "frames", "how long after it; a copy comes last of what comes in a frame", 1, 120)


class RadioReorder(Fault):
    """Packets that come late, after younger ones; a robot obeys them all the same until the next comes."""

    says = "radio that brings {probability:g} of the packets {frames} frames late"

    kind: Literal["radio-reorder"] = setting(
        "radio-reorder", "", "packets are overtaken by others, and robots obey what comes last"
    )
    probability: float = chance("that a packet is late")
    frames: int = setting(..., "frames", "by how much; a late packet comes last of what comes in a frame", 1, 120)


class RadioOut(Fault):
    """Nothing that is sent arrives. Robots obey what they hold, or stand after firmware.timeout_s."""

    says = "radio that is out"

    kind: Literal["radio-out"] = setting("radio-out", "", "nothing that is sent arrives")
