"""Definitions of the numbers in summary.json. The report and compare.md print them, too."""

from omni_mj.results import alpha_windows, metrics, paired_comparison, saturation
from omni_mj.results.seed_statistics import CONFIDENCE

DEFINITIONS = {
    "error": (
        "Absolute difference between the true pose (x_m, y_m, heading_rad) and the timed reference"
        " (ref_x_m, ref_y_m, ref_heading_rad), which is the same for all controllers. Axes: x; y;"
        " position, the distance in the plane; along_track; cross_track; heading, the smallest"
        " angle. Statistics over all frames of a seed: maximum, 99th percentile (p99), mean, root"
        " mean square (rms)"
    ),
    "along_track, cross_track": (
        "Components of the position error along and across the direction of the reference, from"
        " (ref_x_m, ref_y_m)[k-1] to [k+1]. While the reference rests, its last direction is used;"
        " before its first motion, the direction of that motion. If it never moves, the direction"
        " is x"
    ),
    "statistics over seeds": (
        "per_seed contains the value of each seed. median, min, max and mean are taken over the"
        f" seeds. ci95_half_width is half the width of the {100 * CONFIDENCE:g} % confidence"
        " interval of the mean by Student's t distribution. It is null for a single seed"
    ),
    "failures": (
        "Rows that were stopped before their end. Their errors, efforts and settling times are"
        " infinite, written as null. They increase the median, and there is no mean. All other"
        " numbers exclude failed rows. n_failed: number of failed rows"
    ),
    "effort_m_s2": (
        "Root mean square, over the frames, of the change of the commanded translational velocity"
        " per time. It includes the acceleration of the reference"
    ),
    "excess_effort_m_s2": (
        "sqrt(max(effort_m_s2^2 - e^2, 0)), where e is the effort of the reference's velocities,"
        " (ref[k+1] - ref[k]) / T. Commands that are equal to these velocities have none, even if"
        " they are sent earlier because of the dead time"
    ),
    "settle_s": (
        "Time from the end of the reference's last motion until the position error stays below"
        f" {100 * metrics.SETTLED_M:g} cm to the end of the run. It is infinite, written as null,"
        " for a seed that never settles, and there is no mean then. n_settled: number of seeds that"
        " settle"
    ),
    "alpha": (
        "Displacement achieved over displacement commanded in x, in a window of"
        f" n = {alpha_windows.ALPHA_WINDOW_FRAMES} frames of T = 1/60 s: (x_m[k+n] - x_m[k]) /"
        " (T sum of applied_vx_m_s[k:k+n]). Percentiles over all seeds and all k for which the"
        " magnitude of the mean of applied_vx_m_s[k:k+n] is above"
        f" {alpha_windows.ALPHA_MIN_SPEED_M_S} m/s"
    ),
    "peak": (
        "Largest motor voltage, motor current and winding temperature over all seeds. Voltage and"
        " current include every physics step"
    ),
    "drawn_parameters": (
        "Values that [randomization] drew for the robot of a seed and slot: factors of friction, of"
        " the torque constant and of the mass that the wheels carry; wear of the wheels' radius;"
        " shift of the center of that mass. Names with a number hold for that wheel"
    ),
    "events": (
        "First overheated winding, empty battery and failure of each controller and seed; start and"
        " end of each fault"
    ),
    metrics.EXCURSION: (
        "Largest position error of a seed from the first frame of a fault until"
        f" {metrics.RECOVERY_WINDOW_S:g} s after its last, or the end of the run"
    ),
    metrics.RECOVERY: (
        "Time from the first frame of a fault until the position error stays below"
        f" {100 * metrics.RECOVERED_M:g} cm to the end of the same period. It is zero if the error"
        " is never larger, and infinite if the robot does not recover"
    ),
    "saturation": (
        "Fractions of the frames in which a condition holds, for seeds that did not fail."
        " sliding_fraction: slip_*_m_s of a wheel is above"
        f" {saturation.CREEP_FRACTION:g} |v|_c 3 carpet.friction / drivetrain.creep_stiffness +"
        f" {saturation.SLIDING_MARGIN_M_S:g} m/s, where |v|_c is the contact speed of the wheel."
        " voltage_saturated_fraction: peak_duty is 1. current_limited_fraction:"
        " current_limited_fraction_* of a motor is above 0. command_limited_fraction: the command"
        " is at a limit of [control] for speed or acceleration, translation or rotation."
        " mean_duty: mean of peak_duty over the frames"
    ),
    "verdict": (
        "Comparison of the subject's position error, mean over the seeds, with that of every other"
        " controller that is not privileged. A controller with a failed seed has no mean. It is"
        " worse than every controller without a failed seed"
    ),
    "p": (
        "Two-sided p-value of Student's paired t-test. Two controllers are compared by their"
        " differences seed by seed, because the noise of a seed is the same for all controllers."
        f" ci95_half_width_m is half the width of the {100 * CONFIDENCE:g} % confidence interval of"
        " the mean difference. Neither is adjusted for the number of verdicts. Both are null if"
        " there is a single seed or a seed failed"
    ),
    "p_adjusted": (
        "p adjusted by Holm's method for the number of verdicts: all completed scenarios, all"
        " competitors, maximum and mean error, if p is not null. significant: whether p_adjusted is"
        f" at most {100 * paired_comparison.SIGNIFICANCE_LEVEL:g} %. This limits the probability"
        " that any significant difference is due to chance"
    ),
    "privileged": (
        "Controller that gets the true state in place of vision. It does not compete. Its error is"
        " no lower bound for other controllers; omni-mj limit finds such a bound"
    ),
}
