"""The testbed as environments of Gymnasium: `omni_mj/Track-v0`, one robot or many; see docs/how-to/train-a-policy.md.

    import gymnasium
    import omni_mj.gym

    one = gymnasium.make("omni_mj/Track-v0", scenario="rect", plant="planar")
    many = gymnasium.make_vec("omni_mj/Track-v0", 64, scenario="rect", plant="planar")

Importing it registers them. Gymnasium is the extra `omni-mj[gym]`.
"""

try:
    import gymnasium
except ModuleNotFoundError as error:
    if error.name != "gymnasium":
        raise
    get = "pip install 'omni-mj[gym]'"
    raise ImportError(
        f"omni_mj.gym needs the package gymnasium, which is not installed: {get}"
    ) from None

from omni_mj.gym.observations import (
    PREVIEW_FRAMES,
    decode_action,
    encode_observation,
    get_observation_size,
)

__all__ = ["PREVIEW_FRAMES", "decode_action", "encode_observation", "get_observation_size"]

_HOME = "omni_mj.gym.environments"
gymnasium.register(
    "omni_mj/Track-v0",
    entry_point=f"{_HOME}:TrackEnv",
    vector_entry_point=f"{_HOME}:TrackVectorEnv",
)
