"""Layout of results: the names in every group, of which `dynid check` refuses others before a run.

The scene's own names stand as `<output>`, `<method>` and the like. Names are those of arrays, of coordinates
and of the group's attributes; not every result has all of them. docs/reference/results.md, whose groups are
these, says what they are.
"""

from __future__ import annotations

from collections.abc import Iterator

from dynid.bondgraph.analysis_request import MARGINS, PROPERTIES

_RATIO = "numerator numerator_power denominator denominator_power"
_ROOTS = "zero zeros zero_error_bound pole poles pole_error_bound"
_ZERO_DYNAMICS = (
    "note equation polynomial root roots root_error_bound missed_polynomial missed_root missed_roots "
    "missed_root_error_bound foreign_polynomial foreign_root foreign_roots foreign_root_error_bound"
)
_SYSTEMS = (
    "a_polynomial a_root a_roots a_root_error_bound b_polynomial b_root b_roots b_root_error_bound "
    "response_name"
)
_MODES = (
    "independent shared_junctions natural_mode natural_modes natural_mode_error_bound net_power hidden_mode "
    "hidden_modes hidden_mode_error_bound"
)
_PROTOTYPE = (
    "step steps prototype prototype_equation prototype_equation_latex system_a system_a_latex system_b "
    "system_b_latex"
)
_DYNAMICS = {
    "zero_dynamics": f"{_ZERO_DYNAMICS} {_SYSTEMS}",
    "zero_dynamics/response": f"{_RATIO} {_ROOTS} exact",
    "pole_dynamics": _ZERO_DYNAMICS,
    "driving_point": f"{_RATIO} {_ROOTS} exact equation",
}
_PEAKS = "omega output input magnitude"
_RESPONSE = "omega output input response unit"
_TIME_RESPONSE = "note time output source response input unit input_unit"
_HISTORY = (
    "parameter estimate standard_deviation time state state_standard_deviation component unit true "
    "true_state samples stored_every"
)
_NEED = "part why kept kept_names left_out left_out_names"
_BAND = "value low high method"
_ROOT_BANDS = "value low high method_real method_imaginary on_axis multiplicity"
_NAMES = "parameter name unit scale start true"

#: The names in each group.
LAYOUT: dict[str, str] = {
    # Bond graphs.
    "bond_graph": (
        "nodes bonds inputs outputs engine engine_reason engine_limits reading delays approximations "
        "warnings approximate"
    ),
    "bond_graph/causality": (
        "bond bonds element elements state states dependent_storage dependent_storages loop loops conflict "
        "conflicts order order_exact note definition definitions"
    ),
    "bond_graph/causality/zero_dynamics/<output>/<input>": (
        "bond bonds line internal_state derivative_storage zeros_structural relative_degree_structural "
        "zeros_exact relative_degree_exact meaning part parts state rate_of A input equations input_equation "
        "note definition definitions"
    ),
    "bond_graph/transfer_function/<output>/<input>": (
        f"{_RATIO} {_ROOTS} gain zero_error_estimate pole_error_estimate zero_residual pole_residual "
        "symbolic symbolic_numerator symbolic_denominator latex engine reading unit approximate program "
        "program_latex"
    ),
    "bond_graph/properties/<output>/<input>": " ".join(
        {name for names in PROPERTIES.values() for name in names} | {"hidden_mode_note", "approximate"}
    ),
    "bond_graph/sensitivities/<output>/<input>": (
        "note parameter value zero zeros pole poles zero_sensitivity zero_sensitivity_relative "
        "pole_sensitivity pole_sensitivity_relative dc_gain_sensitivity dc_gain_sensitivity_relative "
        "high_frequency_gain_sensitivity high_frequency_gain_sensitivity_relative approximate"
    ),
    "bond_graph/reduction": f"{_PROTOTYPE} output dropped dynamics approximate",
    "bond_graph/reduction/dynamics/<output>": f"{_MODES} approximate",
    "bond_graph/port": f"{_PROTOTYPE} {_MODES} bond junction type meaning approximate",
    **dict.fromkeys(("bond_graph/port/source", "bond_graph/port/load"), "nodes form note approximate"),
    **{
        f"bond_graph/port/{side}/{equivalent}": f"{_RATIO} exact symbolic approximate"
        for side in ("source", "load")
        for equivalent in ("Z_eq", "Y_eq", "e_eq/<name>", "f_eq/<name>")
    },
    **{
        f"{holder}/{name}": f"{names} approximate"
        for holder in ("bond_graph/port", "bond_graph/reduction/dynamics/<output>")
        for name, names in _DYNAMICS.items()
    },
    "bond_graph/port/performance": (
        "input end source_flow source_effort load_flow load_effort operating_flow operating_effort note "
        "approximate"
    ),
    "bond_graph/port/requested/<output>/<input>": f"{_ROOTS} approximate",
    "bond_graph/port/frequency_response": (
        "omega input source_Z_eq source_Y_eq source_e_eq source_f_eq load_Z_eq load_Y_eq load_e_eq load_f_eq "
        "effort flow active_power reactive_power available_power zero_dynamics_response approximate"
    ),
    "bond_graph/state_space": (
        "state rate_of input output derivative A B C D feedthrough delay equations output_equations "
        "definition definitions note"
    ),
    "bond_graph/energy": (
        "storage resistor status mode poles repeated stored_share dissipated_share decay_rate "
        "growth_rate_by_control omega input energy power approximate"
    ),
    "bond_graph/source_performance": "omega",
    "bond_graph/source_performance/<input>": (
        "effort flow impedance active_power reactive_power apparent_power approximate"
    ),
    "bond_graph/system": "stable stability reason unstable_poles largest_sample_time",
    "bond_graph/sampled": "periods pole poles sample computation note",
    "bond_graph/margins": " ".join(MARGINS),
    "bond_graph/sensitivity_functions": "omega loop L S T phase phase_left_out",
    "bond_graph/root_locus": "left_out",
    "bond_graph/root_locus/<loop>": "loop plane gain branch poles zero zeros note",
    "bond_graph/frequency_response": f"{_RESPONSE} phase phase_left_out approximate",
    "bond_graph/frequency_peaks": f"{_PEAKS} approximate",
    "bond_graph/time_response": (
        f"{_TIME_RESPONSE} states order zero_state zero_input nonlinear nonlinear_deviation "
        "nonlinear_tolerance nonlinear_error operating_value error_estimate segments approximate"
    ),
    "bond_graph/zero_input": "initial",
    "bond_graph/zero_input/<output>": f"{_RATIO} exact approximate",
    "bond_graph/operating_point": (
        "variable value unit input input_value residual condition status note slope slope_value slope_unit "
        "chosen equilibrium equilibria stability flat"
    ),
    "bond_graph/state_feedback": "source state gain unit pole poles method",
    "bond_graph/design": (
        "starts ended seed name start value min max bound influence met objective optimum stationarity "
        "curvature active_maxima warnings"
    ),
    "bond_graph/design/targets": (
        "target kind output input unit wanted wanted_damping damping_wanted start start_damping reached "
        "reached_damping residual"
    ),
    "bond_graph/design/optima": "optimum name value objective count",
    "bond_graph/design/compared": "design name target value reached reached_damping",
    "bond_graph/design/frequency_response": "omega channel unit start designed",
    "bond_graph/need": _NEED,
    # Identification.
    "identification": "estimator rejected loss doubt",
    "identification/parameters": (
        f"{_NAMES} estimate standard_error standard_error_total standard_error_scaled identifiable "
        "decided_by low high cramer_rao cramer_rao_without_prior at_bound error_percent other correlation "
        "error_bars"
    ),
    "identification/rejected": f"{_NAMES} estimate at_bound error_percent",
    "identification/equivalent_optima": ("optimum parameter estimate log_likelihood log_posterior undecided"),
    "identification/considered": "parameter quantity unit change visibility slope",
    "identification/diagnostics": (
        "optimum settled converged explained redundancy signal_p signal_explained lack_of_fit_p lacks_fit "
        "residual_rms residual_ratio whiteness_p white log_likelihood bic observations free_parameters "
        "noise_p warnings condition equivalent_optima channel_lack_of_fit_p parameter distance_to_optimum "
        "channel starts starts_agreed passes residual_mean residual_mean_p residual_kurtosis "
        "residual_kurtosis_p residual_largest residual_largest_p outliers lag verdict autocorrelation "
        "autocorrelation_band channel_whiteness_p noise_contradicted channel_noise_p noise_ratio nonlinear_p "
        "prior_conflict prior_contradicted equations evaluations"
    ),
    "identification/stages": "stage parameter estimate residual_ratio iterations chosen",
    "identification/posterior": (
        "parameter k_hat effective_samples k_hat_used effective_samples_used gaussian mean low high "
        "log_evidence samples confidence no_evidence"
    ),
    "identification/robust": "channel scale clipped loss tuning",
    "identification/noise": (
        "kind channel ratio order lag coefficients innovation deviation tried bic other correlation"
    ),
    "identification/nonlinearity": "joint term p size joint_p nonlinear_p verdict nonlinear",
    "identification/laws": "law name estimates log_likelihood bic p distinguishable joints verdict",
    "identification/history": _HISTORY,
    "identification/first_pass": _HISTORY,
    "identification/states": ("time component unit estimate standard_deviation true samples stored_every"),
    "identification/innovations": (
        "time channel normalised mean_square low high overall overall_low overall_high consistent"
    ),
    "identification/residual_spectrum": "omega channel unit amplitude",
    "identification/joints": (
        "joint range fraction amplitude dissipation dissipation_deviation time deflection force "
        "force_deviation measured_deflection measured_force measured_deviation law regime"
    ),
    "identification/held_out": "channel residual_rms residual_ratio unit",
    "identification/held_out/<record>": "time channel channel_time measured predicted unit",
    "identification/measurement": (
        "time omega channel unit measured predicted residual coherence noise given_noise deviation frac "
        "frac_start excitation input_unit input prepared start samples_left_out clock_step clock_drift "
        "clock_jitter clock_dropped clock_duplicated channel_time"
    ),
    "identification/modes": (
        "mode amplitude amplitude_of quantity frequency_measured frequency_std frequency_leverage "
        "frequency_studentised chi2 chi2_degrees model_error model_error_needed "
        "scatter_floor statements sensor computed shape_measured complexity_measured damping_measured "
        "damping_std dof left_out_error left_out_deviation left_out_by_scatter frequency frequency_start "
        "frequency_error frequency_error_start model_mode model_mode_start damping damping_start mac "
        "mac_start mac_table mac_table_start shape shape_start comac comac_start expanded expanded_start"
    ),
    "identification/modes/directions": "direction parameter strength weights label",
    "identification/modes/trade_off/frequencies": "mode frequency_error mac",
    "identification/modes/trade_off/shapes": "mode frequency_error mac",
    "identification/model_error": (
        "parameter unit shift noise_error dominant channel response_error mode frequency frequency_error "
        "reference warning"
    ),
    "identification/identifiability": (
        "at noise parameter unit value bound relative_bound relative_bound_known_state identifiable "
        "singular_value direction condition laws"
    ),
    "identification/identifiability/noise": "channel deviation bound",
    "identification/identifiability/groups": (
        "parameter group parameters seen blind_direction blind of_group"
    ),
    "identification/identifiability/interchangeable": "set optima undecided deciding",
    "identification/identifiability/modal_sensitivity": (
        "mode parameter omega zeta pole omega_by_parameter zeta_by_parameter"
    ),
    "identification/derived": "confidence samples requested",
    "identification/derived/verdicts": "verdict holds probability always statement",
    "identification/derived/poles": f"{_ROOT_BANDS} pole",
    "identification/derived/modes/frequency": f"{_BAND} mode",
    "identification/derived/modes/damping": f"{_BAND} mode",
    "identification/derived/zeros/<output>/<input>": f"{_ROOT_BANDS} zero",
    "identification/derived/zeros/<output>/<input>/frequency": f"{_BAND} pair",
    "identification/derived/zeros/<output>/<input>/damping": f"{_BAND} pair",
    "identification/derived/gains/<output>/<input>/dc": _BAND,
    "identification/derived/gains/<output>/<input>/high_frequency": _BAND,
    "identification/derived/frequency_response/<output>/<input>/magnitude": f"{_BAND} omega",
    "identification/derived/frequency_response/<output>/<input>/phase": f"{_BAND} omega",
    "identification/need": _NEED,
    # Structures and reductions.
    "structure": "doubt",
    "structure/nodes": "doubt",
    "structure/damping": "doubt",
    "structure/modes": (
        "mode omega uncertainty undecided damping loss_factor name dof shape rigid counted doubt massless"
    ),
    "structure/complex_modes": "mode pole omega loss_factor damping whirl dof shape",
    "structure/campbell": "speed mode omega damping whirl",
    "structure/frequency_response": f"{_RESPONSE} method modes error note",
    "structure/frequency_peaks": _PEAKS,
    "structure/time_response": _TIME_RESPONSE,
    "structure/joints": (
        "time joint law deflection rate force work regime events steps change energy_residual note"
    ),
    "response/harmonic_balance": (
        "point omega amplitude phase harmonic response stable multiplier instability "
        "force folds dof output complete note"
    ),
    "response/backbone": "point amplitude first_harmonic omega damping mode note",
    "structure/geometry": (
        "xyz node position edge end face corner lines held joint joint_position mode displacement rotation "
        "sensor sensor_position sensor_direction sensor_turns load load_position load_direction load_turns "
        "shape_sensor shape_sensor_position shape_sensor_direction shape_sensor_turns"
    ),
    "reduction": "method dof solver seconds peak_megabytes doubt",
    "reduction/<method>": (
        "T mass damping stiffness structural_damping masters master modes basis_mode condition frequencies "
        "reference frequency_uncertainty reference_uncertainty frequency_error mac orthogonality "
        "energy_error coordinate column mode full_mode part mass_without_joints damping_without_joints "
        "stiffness_without_joints rule doubt seconds peak_megabytes"
    ),
    "reduction/frf": "omega output input unit full frac",
    "reduction/need": _NEED,
    # Syntheses.
    "synthesis": (
        f"function unit domain kind degree zero zeros pole poles positive_real form residual {_RATIO}"
    ),
    "synthesis/<form>": f"element type value exact node node_type bond residual scene {_RATIO}",
    "synthesis/need": _NEED,
    # Modal analyses.
    "modal": (
        "mode channel reference frequency frequency_standard_error damping damping_standard_error shape "
        "shape_standard_error complexity warning warnings noise reciprocal order periods harmonic harmonics "
        "block_rows"
    ),
    "modal/covariance": "common value factor by_channel channel_value root",
    "modal/chart": "point order chain pole",
    "modal/fit": "omega measured synthesis chi2 degrees lacks_fit reciprocity real_shapes whiteness",
    # Accuracy of alternatives.
    "accuracy": "repeats budget",
    "accuracy/<aspect>": "alternative status title size measure because reference",
    "accuracy/<aspect>/<alternative>": "size runs pareto chosen error bound time memory digits",
}

#: Groups with one of the same layout for each of several records, and the beginning of its name.
OF_RECORDS = frozenset(
    f"identification/{name}"
    for name in (
        *("measurement", "history", "first_pass", "states", "innovations", "residual_spectrum"),
        "joints",
    )
)
RECORD = "record_"
LAYOUT |= {f"{group}/<record>": LAYOUT[group] for group in OF_RECORDS}
#: Attributes of arrays.
ATTRIBUTES = frozenset({"note", "undefined", "per", "status_of", "terms", "approximate"} | {"normalisation"})
#: Attributes of a result itself.
ROOT_ATTRIBUTES = frozenset(
    {"dynid_version", "format", "kind", "title", "created", "status", "python", "packages", "seed"}
    | {"scene", "folder"}
)
Parts = tuple[str, ...]
#: The names of each group; what groups stand in is one as well.
_GROUPS: dict[Parts, frozenset[str]] = {
    parts[:depth]: frozenset()
    for parts in (tuple(group.split("/")) for group in LAYOUT)
    for depth in range(1, len(parts))
} | {tuple(group.split("/")): frozenset(names.split()) for group, names in LAYOUT.items()}


def pattern_of(group: Parts) -> Parts | None:
    """Return the pattern that a group fits, the most literal one; None where no result has it."""
    fitting = [pattern for pattern in _GROUPS if _fits(pattern, group)]
    # The scene's own names beside literal ones: `reduction/frf` is no method.
    return max(fitting, key=lambda pattern: sum(part[0] != "<" for part in pattern), default=None)


def names_in(group: Parts) -> frozenset[str] | None:
    """Return the names in a group; None where no result has it."""
    pattern = pattern_of(group)
    return None if pattern is None else _GROUPS[pattern]


def groups_in(group: Parts) -> Iterator[str]:
    """Yield the literal names of the groups in a group."""
    for pattern in _GROUPS:
        if len(pattern) == len(group) + 1 and pattern[-1][0] != "<" and _fits(pattern[:-1], group):
            yield pattern[-1]


def _fits(pattern: Parts, group: Parts) -> bool:
    return len(pattern) == len(group) and all(
        part == name or (part[0] == "<" and (part != "<record>" or name.startswith(RECORD)))
        for part, name in zip(pattern, group, strict=True)
    )
