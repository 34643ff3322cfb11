"""Controllers in the loop at a fixed step: against the event-accurate reference, the proofs, and derivatives."""

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
import pytest

from tests.vsajax.programs import equations, scans
from tests.vsajax.swings import (
    CONTROLLERS,
    IMPULSE,
    INERTIA,
    KEY,
    RATE,
    SOFT,
    STIFF,
    arm_impact,
    arm_plant,
    link_plant,
    loop,
)
from vsajax import control, plants, sensing
from vsajax.experiments import damping as closed_loop
from vsajax.rollout import sensitivity

each = pytest.mark.parametrize("name", CONTROLLERS)
run_motion = jax.jit(lambda loop: closed_loop.simulate(loop, key=KEY))
run_fine = jax.jit(lambda loop: closed_loop.simulate(loop, key=KEY, substeps=1))
run_score = jax.jit(lambda loop: closed_loop.score(loop, key=KEY))


@pytest.mark.oracle
@each
def test_a_fixed_step_of_half_a_millisecond_settles_as_the_reference(name, swings):
    blows = {"": sensing.Impact(IMPULSE), "rect50_": sensing.Impact(pulse=sensing.Pulse(1.0, 0.05))}
    for prefix, impact in blows.items():
        scores = run_score(loop(CONTROLLERS[name], impact=impact, sample_time=5e-4, duration=3.0))
        assert scores.settling_time == pytest.approx(float(swings[f"{prefix}{name}_settle"]), rel=1e-2)


@pytest.mark.oracle
@each
def test_motion_follows_the_reference(name, swings):
    motion = run_motion(loop(CONTROLLERS[name]))
    rows = np.round(swings["t"] / 1e-3).astype(int)
    tolerance = 2e-2 if name == "law" else 2e-6
    np.testing.assert_allclose(motion.positions[0][rows], swings[f"{name}_x"], rtol=0, atol=tolerance)


@pytest.mark.order
def test_constant_stiffness_converges_with_order_four(swings):
    def error(sample_time: float) -> float:
        motion = closed_loop.simulate(loop(CONTROLLERS["stiff"], sample_time=sample_time), key=KEY, substeps=1)
        return abs(float(motion.positions[0][round(1.0 / sample_time)]) - swings["stiff_x"][t_is_one])

    t_is_one = int(np.flatnonzero(np.isclose(swings["t"], 1.0))[0])
    steps = np.array([0.01, 0.005, 0.0025])
    slope = np.polyfit(np.log(steps), np.log([error(float(step)) for step in steps]), 1)[0]
    assert 3.7 < slope < 4.3


@pytest.mark.oracle
@each
def test_arm_settles_as_the_reference(name, swings):
    plant = arm_plant()
    sample_time = 5e-4
    hit = loop(CONTROLLERS[name], plant, arm_impact(plant), sample_time=sample_time, duration=7.0)
    motion = run_fine(hit)
    np.testing.assert_allclose([v[0] for v in motion.velocities], swings["arm_y0"][2:], atol=1e-6)
    rows = np.round(swings["arm_t"] / sample_time).astype(int)
    found = np.stack([q[rows] for q in motion.positions], axis=1)
    tolerance = 1e-2 if name == "law" else 1e-6
    np.testing.assert_allclose(found, swings[f"arm_{name}"][:, :2], rtol=0, atol=tolerance)
    outside = [np.abs(np.asarray(q)) > np.deg2rad(2.0) for q in motion.positions]
    settled = [motion.time[np.flatnonzero(o)[-1]] for o in outside]
    np.testing.assert_allclose(settled, swings[f"arm_{name}_settle"], rtol=1e-2 if name == "law" else 1e-3)


@pytest.mark.analytic
@pytest.mark.parametrize("seed", [0, 1, pytest.param(2, marks=pytest.mark.slow)])
def test_lyapunov_function_of_the_law_falls_on_random_arms(seed):
    rng, lowest, highest = np.random.default_rng(seed), [0.1, 0.05, 0.3, 1e-4], [0.5, 0.2, 1.0, 1e-3]
    links = tuple(
        plants.ArmLink(mass, length, share * length, inertia, 0.02 * inertia)
        for mass, length, share, inertia in rng.uniform(lowest, highest, (1 + seed % 3, 4))
    )
    plant = plants.SwitchedPlant(plants.PlanarArm(links), plants.StiffnessActuator(SOFT, STIFF))
    impact = sensing.Impact(0.03, shares=tuple(rng.normal(size=len(links))))
    soft, middle = jnp.asarray(SOFT), jnp.asarray(0.5 * (SOFT + STIFF))
    smooth = control.SmoothStiffness(SOFT, STIFF, 5.0, 20.0)
    laws = ((CONTROLLERS["law"], soft), (smooth, middle))
    for controller, stiffness in laws if len(links) == 2 else laws[:1]:
        hit = loop(controller, plant, impact, sample_time=2e-4, duration=0.6)
        motion = run_fine(hit)
        energy = np.asarray(closed_loop.energies(hit, motion, stiffness))
        rises = np.diff(energy)
        # A sampled law is wrong for up to a sample after a switch: V may rise there, and nowhere else.
        signs = np.sign(np.stack([*motion.positions, *motion.velocities]))
        is_switch = (signs[:, 1:] != signs[:, :-1]).any(axis=0)
        assert is_switch.mean() < 0.5
        assert rises[~is_switch].max() < 1e-9 * energy[0]
        assert rises[rises > 0].sum() < 1e-2 * energy[0]
        assert energy[-1] < 0.7 * energy[0]


@pytest.mark.analytic
@pytest.mark.parametrize("joints", [1, 2, 3])
def test_power_is_identity_25(joints):
    # V̇ = −q̇ᵀB q̇ − q̇ᵀ(K − K_min)(q − θ) at any state and any stiffness.
    rng = np.random.default_rng(joints)
    links = tuple(plants.ArmLink(*rng.uniform(0.1, 1.0, 5)) for _ in range(joints))
    plant = plants.SwitchedPlant(plants.PlanarArm(links, gravity=9.81), plants.StiffnessActuator(SOFT, STIFF))
    q, v, k = (tuple(map(jnp.asarray, row)) for row in rng.normal(size=(3, joints)))
    still = (jnp.zeros(()),) * joints
    state = plants.SwitchedState(q, v, k, still)

    def energy(q, v):
        return plant.energy(state._replace(positions=q, velocities=v), jnp.asarray(SOFT))

    _, power = jax.jvp(energy, (q, v), (v, plant.accelerations(state, still)))
    friction = sum(link.damping * s**2 for link, s in zip(links, v, strict=True))
    springs = sum(s * (stiffness - SOFT) * x for s, stiffness, x in zip(v, k, q, strict=True))
    np.testing.assert_allclose(power, -friction - springs, rtol=1e-10)


@pytest.mark.analytic
def test_law_sticks_under_a_load_away_from_both_equilibria():
    # E11: q̇ = 0 is a sliding set wherever some stiffness of the range can hold the load.
    load = 0.02
    held = sensing.Impact(IMPULSE, sensing.Pulse(load, 100.0))
    at_rest = {}
    for name, controller in CONTROLLERS.items():
        hit = loop(controller, impact=held, sample_time=5e-4, duration=8.0)
        motion = run_fine(hit)
        at_rest[name] = np.asarray(motion.positions[0][-500:])
    assert at_rest["soft"].mean() == pytest.approx(load / SOFT, rel=1e-2)
    assert at_rest["stiff"].mean() == pytest.approx(load / STIFF, rel=1e-2)
    assert np.ptp(at_rest["law"]) < 1e-4
    assert 1.5 * load / STIFF < at_rest["law"].mean() < 0.95 * load / SOFT


@pytest.mark.gradient
def test_log_energy_in_lead_slope_and_sharpness_matches_finite_differences():
    hit = loop(control.SmoothStiffness(SOFT, STIFF, 3.0, RATE), link_plant(travel_time=0.1), duration=1.0)

    def where(one):
        return one.controller.conic.lead, one.controller.conic.slope, one.controller.sharpness

    @jax.jit
    def score(values):
        return closed_loop.score(eqx.tree_at(where, hit, tuple(values)), key=KEY).log_energy

    values = jnp.array([0.03, 5.0, 2.0])
    forward, reverse = jax.jacfwd(score)(values), jax.grad(score)(values)
    np.testing.assert_allclose(forward, reverse, rtol=1e-9)
    for i, step in enumerate([1e-6, 1e-4, 1e-4]):
        shift = step * jnp.eye(3)[i]
        slope = (8.0 * (score(values + shift) - score(values - shift))) - (
            score(values + 2 * shift) - score(values - 2 * shift)
        )
        assert forward[i] == pytest.approx(float(slope) / (12.0 * step), rel=1e-6)


@pytest.mark.equivalence
def test_residuals_square_to_the_log_energy():
    hit = loop(CONTROLLERS["law"], duration=1.0)
    residuals = sensitivity.run(closed_loop.residual_loop(hit, key=KEY))
    assert residuals @ residuals == pytest.approx(float(run_score(hit).log_energy), rel=1e-12)


@pytest.mark.equivalence
def test_least_squares_along_the_loop_are_those_of_the_whole_jacobian():
    hit = loop(CONTROLLERS["law"], duration=0.5)
    leaves, rest = eqx.partition((hit.plant, hit.controller), eqx.is_inexact_array)
    numbers, unravel = jax.flatten_util.ravel_pytree(leaves)

    def loop_at(scales):
        plant, controller = eqx.combine(unravel(numbers * scales), rest)
        changed = eqx.tree_at(lambda own: (own.plant, own.controller), hit, (plant, controller))
        return closed_loop.residual_loop(changed, key=KEY)

    at = jnp.ones_like(numbers)
    square = jax.jit(lambda x: sensitivity.normal_equations(loop_at, x))(at)
    whole = jax.jit(
        lambda x: jnp.column_stack(
            [jax.jacfwd(lambda y: sensitivity.run(loop_at(y)))(x), sensitivity.run(loop_at(x))]
        )
    )(at)
    assert np.count_nonzero(np.diag(square)) > 3
    np.testing.assert_allclose(square, whole.T @ whole, rtol=1e-9, atol=1e-12 * np.abs(square).max())


@pytest.mark.equivalence
def test_a_batch_of_noisy_loops_is_its_loops_one_by_one():
    sensor = sensing.FeedbackSensor(1e-3, sensing.Encoder(4096.0), 3.3e-3)
    hit = loop(CONTROLLERS["law"], sensor=sensor, observer=control.SwingObserver(50.0), duration=0.5)
    keys = jax.random.split(KEY, 3)
    together = jax.jit(jax.vmap(lambda key: closed_loop.score(hit, key=key)))(keys)
    one = jax.jit(lambda key: closed_loop.score(hit, key=key))
    for i, key in enumerate(keys):
        alone = one(key)
        jax.tree.map(lambda a, b, i=i: np.testing.assert_allclose(a[i], b, rtol=1e-9, atol=1e-12), together, alone)
    assert len(set(np.asarray(together.log_energy))) == 3


@pytest.mark.analytic
def test_scores_of_a_free_decay():
    band, duration = 0.05, 4.0
    hit = loop(CONTROLLERS["stiff"], duration=duration)
    scores = run_score(hit)
    assert scores.decay_rate == pytest.approx(0.01 / 2 / INERTIA, rel=1e-2)
    motion = run_motion(hit)
    energy = np.asarray(closed_loop.energies(hit, motion, jnp.asarray(0.65)))
    mean = np.mean(np.log1p(energy / (0.5 * 0.65 * band**2)))
    assert scores.log_energy == pytest.approx(mean, rel=1e-12)
    q = np.abs(np.asarray(motion.positions[0]))
    assert scores.peak == q.max()
    assert scores.residual == q[motion.time >= 0.8 * duration].max()
    assert scores.settling_time == pytest.approx(float(motion.time[np.flatnonzero(q > band)[-1]]), abs=1e-3)
    assert (scores.switches, scores.travel, scores.diverged) == (0.0, 0.0, 0.0)


@pytest.mark.analytic
def test_what_does_not_settle_says_so():
    fixed = control.StiffnessSwitch(SOFT, STIFF, control.FixedThresholds(0.0594, 0.743))
    scores = run_score(loop(fixed, link_plant(damping=0.0, travel_time=0.1), duration=20.0, start=SOFT))
    assert scores.settling_time == np.inf
    # Page: a limit cycle of 0.056 rad without friction.
    assert scores.residual == pytest.approx(0.056, abs=0.006)
    assert run_score(loop(CONTROLLERS["law"], band=1e-9)).settling_time == np.inf


@pytest.mark.analytic
def test_stiffness_moves_no_faster_than_its_actuator():
    hit = loop(CONTROLLERS["law"], link_plant(travel_time=0.1), start=SOFT, duration=1.0)
    motion = run_motion(hit)
    stiffness = np.asarray(motion.stiffness[0])
    assert stiffness[0] == SOFT
    assert np.abs(np.diff(stiffness)).max() == pytest.approx((STIFF - SOFT) * 1e-3 / 0.1, rel=1e-9)
    assert stiffness.max() > 0.9 * STIFF


@pytest.mark.structure
def test_a_loop_is_one_scan_without_random_numbers_or_library_calls():
    sensor = sensing.FeedbackSensor(1e-3, sensing.Encoder(4096.0))
    hit = loop(CONTROLLERS["law"], arm_plant(), arm_impact(arm_plant()), sensor=sensor, duration=0.2)
    program = jax.make_jaxpr(lambda one: closed_loop.score(one, key=KEY))(hit)
    bodies = [scan.params["jaxpr"] for scan in scans(program)]
    names = {equation.primitive.name for body in bodies for equation in equations(body)}
    assert "mul" in names
    assert not names & {"dot_general", "random_bits", "threefry2x32", "triangular_solve", "pure_callback", "sort"}


@pytest.mark.failure
def test_an_impact_with_the_wrong_number_of_shares_is_refused():
    with pytest.raises(ValueError, match="one share a joint; got 1 for 2 joints"):
        closed_loop.score(loop(CONTROLLERS["law"], arm_plant(), sensing.Impact(0.1, shares=(1.0,))), key=KEY)
