"""Rules and controllers by what they command, over the registry and one by one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.vsajax.programs import equations
from vsajax import Sample, Swing, control, rollout

SWITCHED = {
    "law (23)": control.Conic(),
    "conic": control.Conic(0.05, 10.0),
    "lead": control.TimeLead(0.05, 0.05),
    "thresholds": control.FixedThresholds(0.06, 0.7),
    "relative": control.RelativeThresholds(0.2, 0.25),
    "release": control.DelayedRelease(0.09),
}
CONTROLLERS = {
    **{name: control.StiffnessSwitch(0.3, 1.0, rule) for name, rule in SWITCHED.items()},
    "held": control.StiffnessSwitch(0.3, 1.0, hold=control.Hold(0.03, 0.02, 0.5)),
    "constant": control.ConstantStiffness(0.3),
    "smooth": control.SmoothStiffness(0.3, 1.0, 3.0, 14.0, conic=control.Conic(0.02, 5.0)),
    "pid": control.PIDPosition(0.65, 0.5, 1.0, 0.05),
    "combined": control.Combined(control.StiffnessSwitch(0.3, 1.0), control.MotorPID(0.5, 1.0, 0.05)),
    "bang-bang": control.BangBangPosition(0.65, 0.6, 0.02, 0.01),
}
each = pytest.mark.parametrize("name", CONTROLLERS)
T = 1e-3


def swing(time, amplitude=1.0, rate=14.0, decay=1.5) -> Swing:
    """Return a decaying oscillation that starts from the centre."""
    shrunk = amplitude * jnp.exp(-decay * time)
    q = shrunk * jnp.sin(rate * time)
    v = shrunk * (rate * jnp.cos(rate * time) - decay * jnp.sin(rate * time))
    a = -2.0 * decay * v - (rate**2 + decay**2) * q
    return Swing(jnp.full_like(q, T), q, v, a, jnp.zeros_like(q))


def run(controller, swings: Swing):
    first = jax.tree.map(lambda x: x[0], swings)
    return rollout.scan(controller.step, controller.init(first), swings)[1]


@pytest.mark.contract
@each
def test_a_controller_is_online_pure_and_exportable(name):
    controller = CONTROLLERS[name]
    swings = swing(jnp.arange(40) * 0.02)
    together = run(controller, swings)
    state = controller.init(jax.tree.map(lambda x: x[0], swings))
    for i in range(40):
        state, command = controller.step(state, jax.tree.map(lambda x, i=i: x[i], swings))
        np.testing.assert_allclose(command.stiffness, together.stiffness[i], rtol=1e-12)
        np.testing.assert_allclose(command.motor_position, together.motor_position[i], atol=1e-12)
    observed = control.ObservedController(controller, control.SwingObserver(50.0))
    sample = Sample(jnp.asarray(T), link_position=jnp.asarray(0.1), motor_position=jnp.asarray(0.0))
    state = observed.init(sample)
    assert all(jnp.shape(leaf) == () for leaf in jax.tree.leaves((observed, state)))
    program = jax.make_jaxpr(observed.step)(state, sample)
    assert {equation.primitive.name for equation in equations(program)} <= {
        *("add", "sub", "mul", "div", "neg", "abs", "max", "min", "exp", "expm1", "tanh", "integer_pow", "square"),
        *(
            "gt",
            "lt",
            "ge",
            "le",
            "eq",
            "ne",
            "and",
            "or",
            "not",
            "select_n",
            "convert_element_type",
            "pjit",
            "jit",
        ),
        *("broadcast_in_dim", "copy", "clamp", "stop_gradient", "sign", "is_finite"),
    }


@pytest.mark.contract
@pytest.mark.parametrize("name", [n for n in SWITCHED if n != "thresholds"])
def test_scale_free_rules_treat_large_and_small_swings_alike(name):
    time = jnp.arange(600) * T
    large, small = (run(CONTROLLERS[name], swing(time + 1e-4, a)).stiffness for a in (1.0, 1e-3))
    np.testing.assert_array_equal(large, small)
    assert 0.2 < float((large > 0.9).mean()) < 0.8


@pytest.mark.analytic
def test_law_23_is_stiff_on_the_way_out_and_soft_on_the_way_back():
    swings = swing(jnp.arange(1, 600) * T)
    stiffness = run(CONTROLLERS["law (23)"], swings).stiffness
    np.testing.assert_array_equal(stiffness > 0.9, swings.position * swings.velocity > 0)
    # Remark 1 as printed, "k_max if q̈ < 0", is another law.
    assert ((stiffness > 0.9) != (swings.acceleration < 0)).mean() > 0.3


@pytest.mark.analytic
def test_thresholds_of_zero_and_no_delay_are_law_23():
    swings = swing(jnp.arange(1, 600) * T)
    law = run(CONTROLLERS["law (23)"], swings).stiffness
    for rule in (
        control.FixedThresholds(0.0, 0.0),
        control.RelativeThresholds(0.0, 0.0),
        control.TimeLead(0.0, 0.0),
        control.DelayedRelease(0.0),
    ):
        np.testing.assert_array_equal(run(control.StiffnessSwitch(0.3, 1.0, rule), swings).stiffness, law)


@pytest.mark.analytic
def test_anticipation_switches_earlier_and_delay_later():
    swings = swing(jnp.arange(1, 300) * T, decay=0.0)

    def first_soft(name: str) -> int:
        return int(np.argmax(np.asarray(run(CONTROLLERS[name], swings).stiffness) < 0.9))

    law = first_soft("law (23)")
    # q̇ + τ q̈ = 0 and q̇ = c q on a sine.
    assert first_soft("lead") == pytest.approx(1e3 * np.arctan(1 / (14 * 0.05)) / 14, abs=1.5)
    assert first_soft("conic") == pytest.approx(1e3 * np.arctan(14 / 10) / 14, abs=1.5)
    # A share of 0.09 of a quarter period of 112 ms.
    assert first_soft("release") == pytest.approx(law + 10, abs=1)


@pytest.mark.analytic
def test_smooth_law_tends_to_law_23_and_is_in_the_middle_at_rest():
    swings = swing(jnp.arange(1, 600) * T)
    sharp = control.SmoothStiffness(0.3, 1.0, 1e6, 14.0, 0.0)
    clear = np.abs(swings.position * swings.velocity) > 1e-3
    law = run(CONTROLLERS["law (23)"], swings).stiffness
    np.testing.assert_allclose(run(sharp, swings).stiffness[clear], law[clear], rtol=1e-9)
    still = jax.tree.map(jnp.zeros_like, jax.tree.map(lambda x: x[0], swings))
    gradient = jax.grad(lambda c: c.step((), still)[1].stiffness)(CONTROLLERS["smooth"])
    assert CONTROLLERS["smooth"].step((), still)[1].stiffness == 0.65
    assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(gradient))


@pytest.mark.analytic
def test_holding_ends_chatter_where_nothing_moves():
    noise = 1e-3 * jax.random.normal(jax.random.key(0), (2, 2000))
    swings = swing(jnp.arange(2000) * T, decay=3.0)
    rattled = swings._replace(position=swings.position + noise[0], velocity=swings.velocity + 100 * noise[1])

    def switches(name: str) -> int:
        return int((jnp.diff(run(CONTROLLERS[name], rattled).stiffness) != 0).sum())

    assert switches("law (23)") > 10 * switches("held")
    assert 4 < switches("held") < 20


@pytest.mark.analytic
def test_bang_bang_stops_at_the_turn_and_comes_back():
    controller = control.BangBangPosition(0.65, 0.2, 0.02)
    quarter = jnp.arange(200) * T
    motor = run(controller, swing(quarter, decay=0.0)).motor_position
    turn = int(np.argmax(np.asarray(motor) > 0.5))
    assert turn * T == pytest.approx(0.5 * np.pi / 14.0, abs=2e-3)
    assert motor[turn] == pytest.approx(1.0, abs=1e-3)
    # Then a turn with the spring undeflected: back along a smooth path.
    still = Swing(*(jnp.full(400, x) for x in (T, 1.0, 0.0, 0.0, 1.0)))
    wobble = still._replace(velocity=jnp.where(jnp.arange(400) % 2 == 0, 1e-6, -1e-6))
    state = controller.init(jax.tree.map(lambda x: x[0], swing(quarter)))._replace(
        target=jnp.ones(()), velocity=jnp.asarray(-1e-6)
    )
    back = np.asarray(rollout.scan(controller.step, state, wobble)[1].motor_position)
    assert back[0] == 1.0
    assert back[-1] == 0.0
    assert (np.diff(back) <= 0).all()


@pytest.mark.analytic
@pytest.mark.parametrize(("share", "is_stable"), [(0.9, True), (1.1, False)])
def test_pid_is_stable_up_to_its_routh_limit(share, is_stable):
    inertia, damping, stiffness, proportional, derivative = 0.00326, 0.01, 0.65, 0.5, 0.05
    limit = (damping + stiffness * derivative) * (1 + proportional) / inertia
    roots = np.roots(
        [inertia, damping + stiffness * derivative, stiffness * (1 + proportional), stiffness * share * limit]
    )
    # I q⃛ + (b + kKd) q̈ + k(1 + Kp) q̇ + kKi q = 0.
    assert (roots.real.max() < 0) == is_stable


@pytest.mark.equivalence
def test_combined_commands_the_stiffness_of_one_and_the_motor_of_the_other():
    swings = swing(jnp.arange(300) * T)._replace(motor_position=jnp.full(300, 0.2))
    both, law, pid = (run(CONTROLLERS[name], swings) for name in ("combined", "law (23)", "pid"))
    np.testing.assert_array_equal(both.stiffness, law.stiffness)
    np.testing.assert_array_equal(both.motor_position, pid.motor_position)
    assert min(np.ptp(both.stiffness), np.ptp(both.motor_position)) > 0.5


@pytest.mark.analytic
def test_relative_thresholds_hold_the_larger_of_the_last_two_peaks():
    decay, rate = 3.0, 14.0
    time = jnp.arange(1, 1200) * T
    swings = swing(time, rate=rate, decay=decay)
    rule = control.RelativeThresholds(0.3, 0.0)
    stiff = np.asarray(run(control.StiffnessSwitch(0.3, 1.0, rule), swings).stiffness) > 0.9
    q, back = np.abs(np.asarray(swings.position)), np.asarray(swings.position * swings.velocity) < 0.0
    # The way back of the second half-swing: stiff below a share of the first peak, the larger one.
    second = back & (np.asarray(time) > np.pi / rate) & (np.asarray(time) < 2 * np.pi / rate)
    np.testing.assert_array_equal(stiff[second], q[second] < 0.3 * q.max())
    own = q[(np.asarray(time) > np.pi / rate)].max()
    assert (stiff[second] != (q[second] < 0.3 * own)).any()
