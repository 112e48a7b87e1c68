"""The paper's own results, tables 3 and 4: absolute position errors in metres."""

# table -> controller -> axis -> statistic
TABLES: dict[int, dict[str, dict[str, dict[str, float]]]] = {
    3: {
        "flc": {"x": {"max": 0.03286, "mean": 0.0036}, "y": {"max": 0.07611, "mean": 0.0133}},
        "comp-flc": {"x": {"max": 0.02124, "mean": 0.00055}, "y": {"max": 0.03864, "mean": 0.0057}},
    },
    4: {
        "flc": {"x": {"max": 0.04557, "mean": 0.0113}, "y": {"max": 0.10154, "mean": 0.0175}},
        "comp-flc": {"x": {"max": 0.03007, "mean": 0.0074}, "y": {"max": 0.04111, "mean": 0.0010}},
    },
}
