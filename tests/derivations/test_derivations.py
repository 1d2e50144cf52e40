"""Every claim is settled again and compared with its record; and the doors to them."""

import dataclasses
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from course import derivations
from course.derivations import Verdict, claim, claims, honest, records, run, unmet
from course.derivations.__main__ import main, select, shown
from course.middleware import controller
from tests import optional

ALL = claims()
FILE = "rigid_body.time_step"
QUICK = "determinant_one_is_stable"
SIMULATORS = {"Drake", "PyBullet"}
SOURCES = Path(__file__).resolve().parents[2] / "notebooks" / "source"
# Checks that take more than 0.3 s of processor time once everything is compiled.
LONG = set(
    """
a_residual_tells aabb_all_axes acceleration_means_inertia adaptive_finds_parameters
adaptive_sum_can_only_fall admittance_is_light angle_error_wraps any_joint_message area_preserved
articulated_bodies_lose_fewer_digits believed_error_bar below_the_limit_sticks best_fixed_gains
bias_to_first_order blocked_ends_are_named both_ends_first box_of_limits bridge_test
bullet_less_accurate cached_roadmap callback_over_a_period camera_off capture_point_stops
cascade_beats_pid centroidal_without_legs chain_age clearance_and_noise clip_keeps
clipped_velocities cloning_averages coal_is_the_truth command_waits_for_picture complete_planners
computing_and_cycle condition_above_hundred connect_in_narrow_passages constraints_take_larger_steps
contact_gradients_vanish contact_is_the_wall contact_seen_is_contact_stopped
continuous_detection_or_smaller_step contracts_before_sliders controller_moves
converged_within_limits convex_cone_is_coulomb critical_instant critical_settles_fastest
dagger_fixes_drift dagger_needs_room damper_damps damping_is_safe damping_makes_things_stick
damping_realism dbscan_has_no_order default_tolerance deformables_need_a_tenth
diffusion_is_collision_free diffusion_mends_drift drake_hydroelastic draws_find_the_plane
edge_by_ten_points engines_agree enough_steps_stop ensembling_averages error_follows_acceleration
estimate_rests_with_the_arm every_joint_has_ku every_recording_identifies feedback_and_regression
fifo_makes_real_time filter_calms filtered_rate_is_late first_to_finish fit_residual
force_gain_is_free fresh_worlds_repeat friction_has_a_step_limit friction_leaves_an_error
friction_of_each_geom friction_wrong_both_ways gain_notices_sooner gap_table gate_replaces_contact
gc_hits_the_loop goal_bias_in_passages gradient_by_differences gradient_search_is_linear
growing_energy half_period_half_error half_the_ultimate_gain heavy_on_light_sinks held_out_error
high_gain_catches hold_is_half_a_sample icp_comes_home imu_start_again informed_area
informed_rrt_star integral_clamp inverse_depth_is_better jitter_below_a_period
jitter_leaves_the_mean joint_states_reliable joints_by_sums kabsch_without_determinant
lag_of_the_arm large_step_at_contact largest_step last_error_blames late_command latency_is_not_age
lazy_tests_the_final_path learned_sampler_speeds_up limit_is_a_wall limits_between_grid_points
limits_keep_an_arm_from_itself linear_beats_hold listed_is_matched listing_converges
listing_energy_decay listing_friction liu_layland_says_no loaded_is_not_sound long_run_mean
look_and_move_limit looked_through_is_wrong losses_add losses_add_up mass_and_period
mass_without_set_const measured_or_randomised mended_parameter mending_makes_worse
more_friction_holds_the_glass more_gain_rejects_everywhere mpc_beats_clipping mujoco_any_stiffness
mujoco_contact_stiffness_limit mujoco_damped_limit mujoco_free_spin_energy
mujoco_implicitfast_gyroscopic mujoco_is_convex_and_unique mujoco_rk4 mujoco_rk4_contact_order
near_the_goal network_knows_its_part next_row normal_matrix_is_covariance
not_looked_through_is_right notch_can_only_help number_of_solutions observer_as_fast_as_possible
one_euler_step one_repair_cures optimisers_get_stuck order_survives_bounces orders_of_accuracy
outline_tells overrun_ages passage_in_more_dimensions pauses pd_difference pd_sample_late
peak_sensitivity_bounds_margins penalty_is_differentiable perfect_model_perfect_tracking
picture_lost_like_packet picture_to_picture pictures_without_bias pid_actuator_guards
pile_of_a_hundred pipeline_keeps_up pixels_are_independent planner_step principal_axis_is_stable
pseudo_inverse_beside pyramid_halves_its_loss pyramid_inscribed pyramid_slips rank_loss_is_failure
ransac_takes_the_table rare_and_sure rare_contact_is_cheap raw_estimate_replans reachable_annulus
react_less reaction_is_age refsafe_keeps_it_stable reliable_arrives reliable_resends_all
repeated_actions reset_world residual_learning_is_faster restart_continues reward_by_the_step
rk4_and_contact rk4_costs_four_times rk4_energy_factor root_sum_square rrt_complete rrt_loop
rrt_star_converges sag_without_kd same_as_mujoco same_seeds same_variance_same_alarms sampler_orders
samples_find_the_plan semi_implicit_arm_energy semi_implicit_bouncing_decays
semi_implicit_damped_limit semi_implicit_stability_per_cost servo_is_a_sampled_loop
set_const_compiles seven_billion_on_board seven_joints_have_no_closed_form shaping_keeps_the_best
shortcut_leaves_corners shortcut_never_lengthens shortcut_share signals_of_different_kinds
signed_parts_add_up singular_start slip_force slow_plans_are_slow_questions smith_removes_the_delay
soft_wall sparse_chance spread_of_symmetric_poses start_when_free step_by_posture
step_through_a_passage stiffness_depends_on_the_wall sweep_and_prune_n_log_n swings_die
symplectic_conserves_energy symplectic_with_varying_step tf_extrapolates thin_wall_missed
time_is_an_end tip_path_then_ik tower_by_engine tower_sags trials_to_tell tutorial_runs two_gains
two_link_mass_matrix two_millimetres_will_do vector_processes_pay vector_zip_of_actions
verlet_frequency ways_missed wobble_comes_from_the_term worked_table_belongs_to_the_method
worked_ten_bounces_rk4 wrong_clock_fails ziegler_nichols_is_safe
""".split()
)


def marks_of(item):
    """A claim's check may need a library that `make test` leaves out, or take long."""
    if SIMULATORS & {*item.needs}:
        return [pytest.mark.optional, pytest.mark.slow]
    return [pytest.mark.prove if item.id in LONG else pytest.mark.slow]


def each(items):
    """The claims as parameters of a test."""
    return [pytest.param(item, id=item.id, marks=marks_of(item)) for item in items]


def outcome_of(item):
    """What the check finds now; the test is skipped where it cannot run."""
    if reason := unmet(item):
        optional.skip(f"the claim {item.id} was NOT checked: {reason}")
    return run(item.id)


@pytest.mark.parametrize("item", each(ALL))
def test_verdict_and_figures_reproduce(item):
    outcome = outcome_of(item)
    assert outcome.agrees, "\n".join(outcome.disagreements)
    assert outcome.finding.statement
    # What a page shows from the record is what it shows when the check runs.
    assert derivations._stated(item.check) in ("", outcome.finding.statement)


@pytest.mark.prove
@pytest.mark.parametrize("item", ALL, ids=lambda item: item.id)
def test_texts_are_complete(item):
    assert len(item.claim) > 15 and len(item.corrected) > 15
    assert item.claim.strip().rstrip(".") != item.corrected.strip().rstrip(".")
    # Also of a claim whose check only the pages run.
    assert honest.typed_numbers(item.corrected) == []


def test_the_long_checks_are_those_of_claims_there_are():
    assert {item.id for item in ALL} >= LONG


def test_the_record_holds_the_claims_there_are():
    for file in records.files():
        assert set(records.load(file)) <= {item.id for item in ALL if item.file == file}, file


def test_ids_are_unique_and_chapters_covered():
    ids = [item.id for item in ALL]
    assert len(ids) == len(set(ids))
    assert sum(len(claims(number)) for number in {item.chapter for item in ALL}) == len(ALL)
    assert len(claims(1)) >= 60 and len(claims(8)) >= 10


def test_some_claims_fail_and_some_hold():
    recorded = [records.load(item.file)[item.id]["verdict"] for item in ALL]
    assert all(recorded.count(verdict.value) >= 5 for verdict in Verdict)


def test_an_id_that_is_taken_is_refused():
    taken = dict.fromkeys(["semi_implicit_limit"], ALL[0])
    check = derivations.CLAIMS["semi_implicit_limit"].check
    with pytest.raises(ValueError, match="must be unique"):
        claim("Something else.", "Something.", registry=taken)(check)


def test_figure_is_computed_once_per_process(monkeypatch):
    calls = []

    def check(result):
        calls.append(1)
        return determinant.check(result)

    determinant = derivations.CLAIMS["determinant_one_is_stable"]
    counted = replace(determinant, id="counted_once", check=check)
    monkeypatch.setitem(derivations.CLAIMS, "counted_once", counted)
    first = derivations.figure("counted_once", "outer_at_2_1")
    assert derivations.figure("counted_once", "outer_at_2_1") == first
    assert len(calls) == 1


def test_figure_and_show():
    limit = derivations.figure("semi_implicit_limit", "limit_ms")
    assert limit == pytest.approx(2000 / 100_000**0.5, rel=1e-9)
    block = derivations.show("semi_implicit_limit")
    assert "6.3246" in repr(block) and "6.3246" in block._repr_markdown_()
    assert "0x" not in repr(block)


def test_a_page_under_test_shows_the_record_without_running_the_check(monkeypatch):
    computed = derivations.show("two_link_jacobian")
    monkeypatch.setenv("COURSE_CLAIMS", "recorded")
    monkeypatch.setattr(derivations, "run", None)
    stored = derivations.show("two_link_jacobian")
    assert stored._repr_markdown_() == computed._repr_markdown_() and repr(stored) == repr(computed)
    assert derivations.figure("two_link_jacobian", "det_at_right_angle") == 0.8


def lacking(monkeypatch):
    """Hide the simulators and the compiler."""
    for name in ("pydrake", "pybullet"):
        for module in [m for m in sys.modules if m.partition(".")[0] == name]:
            monkeypatch.delitem(sys.modules, module)
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr(controller, "compiler", lambda: None)
    monkeypatch.setattr(derivations, "run", run.__wrapped__)


@pytest.mark.parametrize("item", [item for item in ALL if item.needs], ids=lambda item: item.id)
def test_a_card_shows_the_record_whether_or_not_its_needs_are_there(item, monkeypatch):
    lacking(monkeypatch)
    assert "this needs" in unmet(item)
    with pytest.raises((ImportError, FileNotFoundError), match="this needs"):
        item.check(derivations.Result(item.id))
    without = derivations.show(item.id)
    monkeypatch.undo()
    assert derivations.show(item.id)._repr_markdown_() == without._repr_markdown_()
    statement = without.outcome.finding.statement
    assert all(need in statement for need in item.needs)
    measured, _, rest = statement.partition(" These figures are from the stored record: ")
    assert len(measured.split()) >= 4 and rest
    entry = records.load(item.file)[item.id]
    assert without.outcome.finding.verdict.value == entry["verdict"]
    assert "{" not in without.outcome.corrected + without.outcome.condition
    for name, (value, _) in entry["figures"].items():
        assert derivations.figure(item.id, name) == value


@pytest.mark.prove
@pytest.mark.topic("platforms")
def test_no_other_claim_of_the_chapter_needs_a_simulator(monkeypatch):
    """Each needs what it names, as the test before shows; and only those need anything."""
    lacking(monkeypatch)
    for item in claims(3):
        if not item.needs:
            assert derivations.run(item.id).agrees, item.id


def test_the_command_names_what_it_could_not_run(monkeypatch):
    lacking(monkeypatch)
    result = CliRunner().invoke(main, ["--id", "bullet_on_gpu"])
    assert result.exit_code == 0 and "NOT RUN: this needs PyBullet" in result.output
    assert "0 claims" in result.output and "1 not run here; 0 disagree" in result.output
    (data,) = json.loads(CliRunner().invoke(main, ["--id", "bullet_on_gpu", "--json"]).stdout)
    assert data["disagreements"] == [] and "this needs PyBullet" in data["not_run"]


def test_an_unknown_need_is_refused():
    with pytest.raises(ValueError, match=r"needs must be among Drake, .*, got 'Gazebo'"):
        replace(ALL[0], needs=("Gazebo",))


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: derivations.figure("no_such_claim", "x"), "no_such_claim"),
        (lambda: derivations.figure("semi_implicit_limit", "nothing"), "limit_ms"),
        (lambda: derivations.claims(77), "77"),
        (lambda: derivations.show("no_such_claim"), "no_such_claim"),
        (lambda: derivations.show("rk4_limt"), "did you mean rk4_limit"),
        (lambda: derivations.answer("planar_state", "6"), "semi_implicit_limit"),
    ],
)
def test_bad_input_is_named(call, named):
    with pytest.raises(ValueError, match=named):
        call()


def test_importing_is_light():
    code = (
        "import sys, course.derivations as d; d.claims();"
        "heavy = {'sympy', 'mujoco', 'scipy', 'matplotlib', 'torch'} & set(sys.modules);"
        "print(sorted(heavy))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout.strip() == "[]", result.stdout + result.stderr


@pytest.fixture
def changed(monkeypatch):
    """Changes a real claim for one test."""

    def change(**fields):
        item = replace(derivations.CLAIMS[QUICK], **fields)
        monkeypatch.setitem(derivations.CLAIMS, QUICK, item)
        # What the other claims gave is kept, as `test_mutations.py` asks for it too.
        monkeypatch.setattr("course.derivations.__main__.run", derivations.run.__wrapped__)

    return change


@pytest.mark.slow
def test_command_prints_a_table_of_80_columns():
    result = subprocess.run(
        [sys.executable, "-m", "course.derivations", "--id", "semi_implicit_limit"],
        capture_output=True,
        text=True,
        env={"COLUMNS": "80", "PATH": "/usr/bin:/bin", "HOME": "/nonexistent", "LANG": "C.UTF-8"},
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "semi_implicit_limit" in result.stdout and "limit_ms = 6.3246" in result.stdout
    assert "1 claim (1 " in result.stdout.splitlines()[-1]
    assert max(len(line) for line in result.stdout.splitlines()) <= 80


def test_command_prints_json():
    result = CliRunner().invoke(main, ["1", "--id", QUICK, "--json"])
    (data,) = json.loads(result.stdout)
    assert data["verdict"] == "holds only if" and data["condition"]
    assert data["figures"]["outer_at_2_1"] == pytest.approx(-1.877328, rel=1e-6)
    assert data["disagreements"] == []
    assert result.exit_code == 0


def test_command_exits_with_1_when_something_disagrees(changed):
    changed(corrected="It is always stable.")
    result = CliRunner().invoke(main, ["--id", QUICK])
    assert result.exit_code == 1 and "DISAGREES" in result.output


def test_a_check_that_breaks_is_reported_not_raised(changed):
    changed(check=lambda result: 1 / 0)
    result = CliRunner().invoke(main, ["--id", QUICK])
    assert result.exit_code == 1 and "ZeroDivisionError" in result.output


@pytest.mark.parametrize("arguments", [("77",), ("juggling",), ("--id", "no_such_claim")])
def test_command_refuses_what_is_not_there(arguments):
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2
    assert arguments[-1] in result.stderr


def test_command_selects_by_chapter_topic_and_file():
    assert select("1", ()) == claims(1) == select("rigid_body", ())
    assert {item.file for item in select(FILE, ())} == {FILE}
    assert select(None, ()) == claims()
    assert [item.id for item in select(None, ("integral_clamp",))] == ["integral_clamp"]


def test_one_claim_imports_only_its_own_file() -> None:
    code = (
        "import sys; from course.derivations import defining\n"
        "print([c.id for c in defining(['integral_clamp']) if c.id == 'integral_clamp'])\n"
        "print([m for m in sys.modules if m.startswith('course.derivations.control.')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:2] == [
        "['integral_clamp']",
        "['course.derivations.control.pid']",
    ]


def test_what_a_notebook_shows_is_a_claim_of_its_chapter_or_one_before():
    sources = Path(__file__).parents[2] / "notebooks" / "source"
    for path in sources.glob("[0-9][0-9]_*.py"):
        named = set(re.findall(r'\b(?:show|answer|figure)\(\s*"(\w+)"', path.read_text("utf-8")))
        other = {item.id for item in ALL if item.chapter <= int(path.name[:2]) and shown(item)}
        assert named <= other, path.name
    assert shown(derivations.CLAIMS["semi_implicit_limit"])
    elsewhere = dataclasses.replace(derivations.CLAIMS[QUICK], id="in_no_notebook")
    assert not shown(elsewhere)


# --- writing the record -------------------------------------------------------------------------


@pytest.fixture
def copied(tmp_path, monkeypatch):
    """The record of one file in a folder of its own, and the command there."""
    text = (records.FOLDER / f"{FILE}.toml").read_text(encoding="utf-8")
    monkeypatch.setattr(records, "FOLDER", tmp_path)
    records.load.cache_clear()
    path = tmp_path / f"{FILE}.toml"
    path.write_text(text, encoding="utf-8")
    yield path, lambda *arguments: CliRunner().invoke(main, [*arguments, "--record"])
    records.load.cache_clear()


@pytest.mark.slow
def test_record_writes_nothing_when_nothing_changed(copied):
    path, command = copied
    before = path.read_text(encoding="utf-8")
    result = command(FILE)
    assert (result.exit_code, result.output) == (0, "")
    assert path.read_text(encoding="utf-8") == before


def test_record_prints_what_changes_and_touches_only_what_was_asked_for(copied):
    path, command = copied
    right = path.read_text(encoding="utf-8")
    wrong = right.replace("[-1.877328045, 1e-06]", "[-1.9, 1e-06]").replace(
        'verdict = "holds"\n', 'verdict = "false"\n'
    )
    path.write_text(wrong, encoding="utf-8")
    records.load.cache_clear()
    result = command("--id", QUICK)
    assert result.exit_code == 0
    assert result.output.startswith(f"{QUICK}: outer_at_2_1 is -1.87")
    assert len(result.output.splitlines()) == 1
    half = path.read_text(encoding="utf-8")
    assert "-1.877328045" in half and 'verdict = "holds"\n' not in half
    result = command(FILE)
    assert result.output == "semi_implicit_limit: verdict on record: 'false'; found: 'holds'\n"
    assert path.read_text(encoding="utf-8") == right


def test_record_refuses_a_claim_that_fails_by_itself(copied, changed):
    path, command = copied
    right = path.read_text(encoding="utf-8")
    changed(corrected="Below 1.5 m.")
    result = command("--id", QUICK)
    assert result.exit_code == 1 and "NOT WRITTEN: '1.5 m'" in result.output
    assert path.read_text(encoding="utf-8") == right


def test_record_drops_a_claim_that_is_gone(copied):
    path, command = copied
    right = path.read_text(encoding="utf-8")
    missing = right.replace(f"[{QUICK}]", "[gone]").replace(f"[{QUICK}.figures]", "[gone.figures]")
    path.write_text(missing, encoding="utf-8")
    records.load.cache_clear()
    result = command(FILE)
    assert f"{QUICK}: new on record" in result.output and "gone: leaves the record" in result.output
    assert path.read_text(encoding="utf-8") == right
