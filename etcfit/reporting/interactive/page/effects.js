"use strict";
/* The effects of etcfit/model/effects, formula by formula: each adds to the balances of torque and voltage.

   `add(p, x, z, u, c)`: p values (SI) by symbol, x state {i, theta, omega}, z memories of all effects with its own ones
   from `at` on, u inputs, c the sum so far. What is not here the page names as left out: no name, no claim. */
(function (etcfit) {
  const sign = Math.sign, abs = Math.abs, exp = Math.exp, tanh = Math.tanh;

  /* Share of the Stribeck speed below which a power would have no finite slope, and the largest power's logarithm. */
  const AT_REST = 1e-12, VANISHED = 6;
  const CONTACT = 0.02; // N m through the teeth below which they are not firmly in contact
  const LIVELIEST = 0.95; // restitution at most
  const S_PEAK = 6 * Math.sqrt(3);
  const FASTEST = 1e-9; // s

  const gearLoad = (u) => 0.5 * (u.motor - u.external);

  etcfit.EFFECTS = {
    // Eqs. 1-2
    armature: { add(p, x, z, u, c) {
      c.voltage -= (p.R_a + u.series) * x.i + p.K_b * u.gear_ratio * x.omega;
      c.drive += u.gear_ratio * p.K_m * x.i;
      c.inductance += p.L_a;
    } },
    inertia: { add(p, x, z, u, c) { c.inertia += u.gear_ratio ** 2 * p.J_m + u.plate * p.J_L; } },
    viscous_friction: { add(p, x, z, u, c) { c.torque -= (u.gear_ratio ** 2 * p.B_m + u.plate * p.B_L) * x.omega; } },
    return_spring: { add(p, x, z, u, c) { c.torque -= u.plate * (p.K_s * x.theta + p.T_PL); } },
    coulomb_friction: { add(p, x, z, u, c) { c.friction += u.plate * p.T_f; } },
    end_stops: { add(p, x, z, u, c) {
      if (u.plate > 0.5) { c.lower = Math.max(c.lower, u.lower); c.upper = Math.min(c.upper, u.upper); }
    } },
    // electrical
    brush_voltage_drop: { add(p, x, z, u, c) { c.voltage -= p.V_b * tanh(x.i / p.i_b); } },
    winding_heating: { z0: [0], add(p, x, z, u, c, at) {
      c.voltage -= p.r_h * z[at] * x.i;
      c.dz[at] = x.i ** 2 - z[at] / p.tau_h;
    } },
    driver_dead_zone: { add(p, x, z, u, c) { c.voltage -= sign(u.voltage) * Math.min(abs(u.voltage), p.V_d); } },
    actuation_delay: { add(p, x, z, u, c) { c.input_delay += p.t_a; } },
    torque_saturation: { loaded: true, add(p, x, z, u, c) {
      const excess = 2 * p.S_T * u.motor ** 2, root = Math.sqrt(1 + excess);
      c.drive -= u.motor * excess / (root * (1 + root));
    } },
    // mechanical
    limp_home_spring: { add(p, x, z, u, c) {
      const below = (p.theta_lh - x.theta) / p.d_lh, small = exp(-abs(below));
      const share = (below > 0 ? 1 : small) / (1 + small);
      c.torque += u.plate * (p.T_lh * share + p.K_lh * p.d_lh * (Math.max(below, 0) + Math.log1p(small)));
    } },
    stiffening_spring: { add(p, x, z, u, c) { c.torque -= u.plate * p.K_3 * x.theta ** 3; } },
    stribeck_friction: { add(p, x, z, u, c) {
      const power = exp(Math.min(p.delta_s * Math.log(Math.max(abs(x.omega) / p.omega_s, AT_REST)), VANISHED));
      c.friction += u.plate * p.T_s * exp(-power);
    } },
    asymmetric_friction: { add(p, x, z, u, c) { c.torque -= u.plate * (p.T_a + p.B_a * abs(x.omega)); } },
    load_dependent_friction: { loaded: true, add(p, x, z, u, c) {
      c.friction += u.plate * p.mu_g * abs(gearLoad(u));
    } },
    motor_coulomb_friction: { add(p, x, z, u, c) { c.friction += u.gear_ratio * p.T_m; } },
    presliding_friction: { z0: [0], add(p, x, z, u, c, at) {
      c.dz[at] = (x.omega - abs(x.omega) * z[at]) / p.delta_z;
      c.torque -= u.plate * p.T_z * (z[at] + p.tau_z * c.dz[at]);
    } },
    backlash: { z0: [1], loaded: true, add(p, x, z, u, c, at) {
      const behind = 0.5 * u.plate * p.g_b * (1 - z[at]), below = u.plate > 0.5 ? u.lower - x.theta : 0;
      c.position += p.g_b > 0 ? Math.max(behind, below) : behind;
      c.play += Math.max(p.g_b, 0);
      c.toothDamping += p.c_b;
      c.toothRestitution += Math.min(p.e_b, LIVELIEST);
      c.dz[at] = u.plate * (tanh(gearLoad(u) / CONTACT) - z[at]) / p.t_b;
    } },
    cogging_torque: { add(p, x, z, u, c) {
      const phase = p.n_c * u.gear_ratio * x.theta;
      c.torque -= u.plate * (p.A_c * Math.cos(phase) + p.A_s * Math.sin(phase));
    } },
    quadratic_drag: { add(p, x, z, u, c) { c.torque -= u.plate * p.D_q * x.omega * abs(x.omega); } },
    airflow_torque: { add(p, x, z, u, c) {
      c.torque -= u.plate * (p.T_air * Math.sin(2 * x.theta) + p.T_air2 * Math.sin(4 * x.theta));
    } },
    stop_bounce: { add(p, x, z, u, c) { c.restitution += u.plate * Math.min(p.e_r, LIVELIEST); } },
    gravity_load: { add(p, x, z, u, c) { c.torque -= u.plate * p.T_g * Math.sin(x.theta); } },
    // sensors
    position_sensor_lag: { z0: [0], add(p, x, z, u, c, at) {
      c.position -= u.plate * p.tau_p * z[at];
      c.dz[at] = (x.omega - z[at]) / Math.max(p.tau_p, FASTEST);
    } },
    position_sensor_nonlinearity: { add(p, x, z, u, c) {
      const lower = isFinite(u.lower) ? u.lower : -Math.PI;
      const span = (isFinite(u.upper) ? u.upper : Math.PI) - lower;
      const s = (x.theta - lower) / (span > 0 ? span : 1), bow = s * (1 - s);
      c.position += u.plate * bow * (4 * p.E_2 + S_PEAK * p.E_3 * (1 - 2 * s));
    } },
    current_sensor_offset: { add(p, x, z, u, c) { c.current += p.I_0; } },
    channel_delay: { add(p, x, z, u, c) { c.current_delay += p.t_c; } },
  };
})(globalThis.etcfit ??= {});
