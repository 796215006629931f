"""Names that files of runs and datasets have, which arrays of the user's own may not have.

The analysis, which knows the variables of datasets, is above this floor and takes long to import; a
test says which name is missing here.
"""

# Means over runs of datasets, each of which has a standard error and an interval, too.
MEANS_WITH_INTERVALS = """
    bath_velocity_autocorrelation collision_rate collision_rate_at_temperature
    component_diffusion component_diffusion_running component_green_kubo component_msd
    component_non_gaussian_parameter component_slope component_velocity_autocorrelation
    compressibility compressibility_rate contact_density contact_value contact_value_rate
    density_profile diffusion_coefficient diffusion_running green_kubo kinetic_temperature
    kurtosis msd msd_over_4t non_gaussian_parameter orientational_order
    orientational_order_squared pair_distribution slope species_energy speed_density
    tracer_collision_rate tracer_collision_rate_at_temperature vacf_initial_slope
    velocity_autocorrelation velocity_density wall_compressibility wall_pressure
"""
OTHER_NAMES = """
    a accessible_half_width b box_size box_width channel_axis chi_square component
    component_diffusion_mark component_displacement_velocity component_drift_diffusion
    component_growth_exponent component_velocity_displacement
    component_growth_exponent_standard_error component_intercept
    component_intercept_standard_error component_quartic_displacement component_slope_change
    component_msd_limit component_slope_change_p_value component_slope_change_standard_error
    component_square_displacement component_wall_reduction contact_distance
    degrees_of_freedom diffusion_mark disk displacement_counts displacement_counts_high
    displacement_counts_low displacement_overflow displacement_time displacement_velocity
    distance drift drift_diffusion drift_p_value drift_standard_error duration energy_drift
    engine enskog_collision_rate enskog_compressibility enskog_contact_value
    enskog_diffusion enskog_tracer_collision_rate event_time expected_counts
    expected_overflow failed failed_runs first_passage_median
    first_passage_median_high first_passage_median_low first_passage_survival
    first_passage_survival_high first_passage_survival_low first_passage_time friction_rate
    growth_exponent growth_exponent_standard_error image impulse initial_square_speed intercept
    intercept_standard_error kinetic_energy kurtosis_p_value mass missed_collisions model
    model_diffusion_coefficient momentum_residual msd_limit
    non_gaussian_parameter_controlled non_gaussian_parameter_controlled_standard_error
    not_diffusive_before p_value p_value_joint packing_fraction pair_collisions
    pair_collisions_standard_error pair_counts pair_expected pair_snapshots particles
    position power_5_percent quantity quarter quarter_collisions quarter_energy
    quarter_order quarter_virial quartic_displacement r r_inner r_outer radius
    run_component_diffusion run_component_msd run_diffusion_coefficient run_msd run_status
    runs scene seed
    slope_change slope_change_p_value slope_change_standard_error species species_pair
    speed_bin speed_counts square_displacement stopped time time_to_try tracer_collisions
    tracer_collisions_standard_error unwrapped vacf_initial_slope_expected vacf_tail
    velocity velocity_bin velocity_counts velocity_displacement virial wall_collisions
    wall_collisions_standard_error wall_distance wall_impulse wall_reduction window
    window_drift_diffusion window_end window_start worst_overlap
"""


def _all_names() -> frozenset[str]:
    names = {*OTHER_NAMES.split()}
    for name in MEANS_WITH_INTERVALS.split():
        names |= {name, f"{name}_standard_error", f"{name}_low", f"{name}_high"}
    return frozenset(names)


RESERVED_NAMES = _all_names()
