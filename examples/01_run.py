"""Run the paper's experiment on the paper's plant, and print the result."""

import omni_mj as om

rect = om.load_scenario("rect", plant="kinematic", radio={"delay_frames": 9})
result = om.run(rect, ["flc", "comp-flc", "adaptive-comp-flc"], seeds=range(3))

print(result.table())
frames = result.frames()  # an Arrow table with a line per robot and frame
print(f"{frames.num_rows} lines, {', '.join(frames.column_names[:9])}, ...")
