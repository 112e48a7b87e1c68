"""The controllers' names; where each is, to be loaded when it is asked for: a list of them needs none of them."""

CONTROLLERS: dict[str, str] = {
    "flc": "omni_control.controllers.flc:Flc",
    "comp-flc": "omni_control.controllers.flc:CompFlc",
    "comp-flc-lag": "omni_control.controllers.flc:CompFlcLag",
    "adaptive-comp-flc": "omni_control.controllers.adaptive:AdaptiveCompFlc",
    "p": "omni_control.controllers.classic:Proportional",
    "smith": "omni_control.controllers.classic:Smith",
    "lqr": "omni_control.controllers.lqr:Lqr",
    "oracle": "omni_control.controllers.oracle:Oracle",
}
