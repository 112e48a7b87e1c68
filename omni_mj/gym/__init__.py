"""Gymnasium environments of the testbed: `omni_mj/Track-v0`; see docs/how-to/train-a-policy.md.

    import gymnasium
    import omni_mj.gym

    env = gymnasium.make("omni_mj/Track-v0", scenario="rect", plant="planar")
    envs = gymnasium.make_vec("omni_mj/Track-v0", 64, scenario="rect", plant="planar")

Importing this package registers them. Gymnasium is in the extra `omni-mj[gym]`.
"""

try:
    import gymnasium
except ModuleNotFoundError as error:
    if error.name != "gymnasium":
        raise
    from omni_control.install_hints import describe_installation

    raise ImportError(
        "omni_mj.gym needs the package gymnasium, which is not installed; "
        f"install it with {describe_installation('gym')}"
    ) from None

from omni_mj.gym.observations import (
    PREVIEW_FRAMES,
    decode_action,
    encode_observation,
    get_observation_size,
)

__all__ = ["PREVIEW_FRAMES", "decode_action", "encode_observation", "get_observation_size"]

_ENVIRONMENTS = "omni_mj.gym.environments"
gymnasium.register(
    "omni_mj/Track-v0",
    entry_point=f"{_ENVIRONMENTS}:TrackEnv",
    vector_entry_point=f"{_ENVIRONMENTS}:TrackVectorEnv",
)
