"use strict";
/* The closed loop of etcfit/control/pid: the ECU's discrete PID around the plant, tick by tick, and how a response is
   judged. The same scheme in the same steps, so that both agree to the error of arithmetic; without the sensor's noise. */
(function (etcfit) {
  const SETTLED = 0.02, NEGLIGIBLE = 2e-3, LEAST_OVERSHOT = 0.01, LEAST_HELD = 0.4, TAIL = 0.25;

  const clamp = (value, most) => Math.min(Math.max(value, -most), most);
  /* Half to even, as the firmware model's rounding does. */
  function rounded(value) {
    const floor = Math.floor(value), rest = value - floor;
    return rest === 0.5 ? floor + (floor % 2 ? 1 : 0) : Math.round(value);
  }
  const quantised = (value, step) => (step > 0 ? step * rounded(value / step) : value);

  /* Straight between corners; the last corner of several at one instant counts from there on. */
  function between(t, corners, values) {
    if (t <= corners[0]) return values[0];
    let k = corners.findIndex((corner) => corner > t);
    if (k < 0) return values[values.length - 1];
    const span = corners[k] - corners[k - 1];
    return values[k - 1] + (values[k] - values[k - 1]) * (t - corners[k - 1]) / span;
  }

  /* What is put ahead for friction and drag at a rate of the setpoint, as `Sliding.volts`. */
  function moving(sliding, rate) {
    if (!sliding) return 0;
    const share = Math.min(Math.abs(rate) / sliding.full, 1);
    return (rate > 0 ? sliding.opening : -sliding.closing) * share + sliding.slope * rate;
  }

  function tick(gains, ecu, memory, setpoint, position, bias) {
    const limit = ecu.duty * ecu.supply, seen = quantised(position, ecu.resolution);
    const error = setpoint - seen, tracked = ecu.derivative_weight * setpoint - seen;
    const derivative = (ecu.filter * memory.derivative + tracked - memory.last) / (ecu.filter + ecu.period);
    let integral = Math.abs(error) >= ecu.dead_band ? memory.integral + gains.Ki * ecu.period * error : memory.integral;
    if (ecu.integral > 0) integral = clamp(integral, ecu.integral * ecu.supply);
    const wanted = gains.Kp * (ecu.setpoint_weight * setpoint - seen) + integral + gains.Kd * derivative;
    let volts = clamp(clamp(wanted, ecu.supply) + bias, limit);
    if (ecu.slew > 0) {
      const most = ecu.slew * ecu.period;
      volts = Math.min(Math.max(volts, memory.output - most), memory.output + most);
    }
    if ((wanted + bias - volts) * error > 0 && ecu.integral === 0) integral = memory.integral;
    return { volts: quantised(volts, ecu.pwm), memory: { integral, derivative, last: tracked, output: volts } };
  }

  /* Share of each part of a tick in which each voltage acts, newest first. */
  function acting(late, parts, room) {
    return Array.from({ length: parts }, (_, k) => Array.from({ length: room }, (_, m) => {
      const begin = m === room - 1 ? -Infinity : late - m, end = late - m + 1;
      return parts * Math.max(Math.min(end, (k + 1) / parts) - Math.max(begin, k / parts), 0);
    }));
  }

  /* The response to the page's setpoint. loop: as in the page's data; gains: Kp, Ki, Kd; until: s. */
  etcfit.runLoop = function (loop, effects, values, gains, until) {
    const { ecu, body } = loop, plant = new etcfit.Plant(effects, values), span = body.upper - body.lower;
    const late = (ecu.delay + plant.delays().input) / ecu.period;
    const parts = Math.max(1, Math.ceil(ecu.period / loop.longest_step - 1e-9)), dt = ecu.period / parts;
    const room = late > 0 ? Math.ceil(late) + 2 : 1, weights = acting(late, parts, room);
    const u = { ...body, plate: 1, series: 0, circuit: 1, mobile: 1, voltage: 0, torque: 0, motor: 0, external: 0 };
    const ticks = Math.round(until / ecu.period), sent = new Array(room).fill(0), constant = () => u;
    const angle = (share) => body.lower + share * span;
    const start = angle(loop.setpoint.shares[0]), lag = ecu.lag > 0 ? dt / ecu.lag : Infinity;
    let x = { i: 0, theta: start, omega: 0 }, z = [...plant.z0];
    const seen = (volts) => {
      u.voltage = volts;
      return x.theta + plant.contributions(x, z, u).position;
    };
    let shown = seen(0);
    let memory = { integral: (1 - ecu.setpoint_weight) * gains.Kp * start, derivative: 0,
                   last: (ecu.derivative_weight - 1) * start, output: 0 };
    let rate = 0, before = start;
    const path = { t: [], setpoint: [], share: [], volts: [], current: [] };
    for (let n = 0; n < ticks; n++) {
      const t = n * ecu.period, share = between(t, loop.setpoint.times, loop.setpoint.shares), wanted = angle(share);
      rate = (ecu.filter * rate + wanted - before) / (ecu.filter + ecu.period);
      before = wanted;
      const bias = loop.bias ? between(wanted, loop.bias.angles, loop.bias.volts) : 0;
      const out = tick(gains, ecu, memory, wanted, shown, bias + moving(loop.sliding, rate));
      memory = out.memory;
      sent.unshift(out.volts);
      sent.pop();
      path.t.push(t);
      path.setpoint.push(share);
      path.share.push((x.theta - body.lower) / span);
      path.volts.push(out.volts);
      path.current.push(x.i);
      for (let k = 0; k < parts; k++) {
        const mean = sent.reduce((sum, volts, m) => sum + weights[k][m] * volts, 0), before = seen(out.volts);
        u.voltage = mean;
        ({ x, z } = plant.step(x, z, dt, constant));
        const now = seen(out.volts);
        if (lag === Infinity) shown = now;
        else {
          const behind = (now - before) / lag;
          shown = now - behind + (shown - before + behind) * Math.exp(-lag);
        }
      }
      if (!Number.isFinite(x.theta)) return null;
    }
    return path;
  };

  /* Overshoot (%), settling time (s), steady-state error (%) and RMSE (%), the worst of all levels: the paper's
     definitions, as etcfit/control/pid/response.py has them. */
  etcfit.judge = function (path, levels) {
    const period = path.t[1] - path.t[0];
    const index = (instant) => Math.max(0, Math.ceil((instant - 0.5 * period) / period - 1e-9));
    const worst = { overshoot_pct: 0, settling_s: 0, steady_state_error_pct: 0 };
    for (const level of levels) {
      const begin = index(level.begins), end = Math.min(index(level.ends), path.t.length);
      const change = level.after - level.before, size = Math.abs(change), tail = begin + Math.round((1 - TAIL) * (end - begin));
      let beyond = 0, held = 0, settles = 0;
      for (let k = begin; k < end; k++) {
        const past = (path.share[k] - level.after) * Math.sign(change);
        beyond = Math.max(beyond, past);
        if (Math.abs(past) > Math.max(SETTLED * size, NEGLIGIBLE)) settles = k + 1 < end ? path.t[k + 1] - level.begins : Infinity;
        if (k >= tail) held = Math.max(held, Math.abs(past));
      }
      worst.overshoot_pct = Math.max(worst.overshoot_pct, 100 * beyond / Math.max(size, LEAST_OVERSHOT));
      worst.settling_s = Math.max(worst.settling_s, settles);
      worst.steady_state_error_pct = Math.max(worst.steady_state_error_pct, 100 * held / Math.max(size, LEAST_HELD));
    }
    const from = index(levels[0].begins), to = Math.min(index(levels[levels.length - 1].ends), path.t.length);
    let square = 0;
    for (let k = from; k < to; k++) square += (path.share[k] - path.setpoint[k]) ** 2;
    return { ...worst, rmse_pct: 100 * Math.sqrt(square / Math.max(1, to - from)) };
  };
})(globalThis.etcfit ??= {});
