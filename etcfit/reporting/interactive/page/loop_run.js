"use strict";
/* The closed loop of etcfit/control/pid: the printed PID around the printed plant, tick by tick, and how a response is
   judged. The same steps, so that both agree to the error of arithmetic; without the sensor's noise. */
(function (etcfit) {
  const SETTLED = 0.02, NEGLIGIBLE = 2e-3, LEAST_OVERSHOT = 0.01, LEAST_HELD = 0.4, TAIL = 0.25;

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

  /* Share of each part of a tick in which each voltage acts, newest first. */
  function acting(late, parts, room) {
    return Array.from({ length: parts }, (_, k) => Array.from({ length: room }, (_, m) => {
      const begin = m === room - 1 ? -Infinity : late - m, end = late - m + 1;
      return parts * Math.max(Math.min(end, (k + 1) / parts) - Math.max(begin, k / parts), 0);
    }));
  }

  /* The response to the page's setpoint. loop: as in the page's data; values: SI by symbol; gains: Kp, Ki, Kd; until: s. */
  etcfit.runLoop = function (loop, values, gains, until) {
    const { model } = etcfit, { ecu, body } = loop, span = body.upper - body.lower, read = new Float64Array(4);
    model.delays(values, read);
    const late = (ecu.delay + read[0]) / ecu.period;
    const parts = Math.max(1, Math.ceil(ecu.period / loop.longest_step - 1e-9)), dt = ecu.period / parts;
    const room = late > 0 ? Math.ceil(late) + 2 : 1, weights = acting(late, parts, room);
    const u = { dt, voltage0: 0, voltage1: 0, torque0: 0, torque1: 0, time: 0, mobile: 1, circuit: 1, plate: 1, series: 0, ...body };
    const ticks = Math.round(until / ecu.period), sent = new Array(room).fill(0);
    const angle = (share) => body.lower + share * span, start = angle(loop.setpoint.shares[0]);
    const x = Float64Array.of(0, start, 0, ...model.z0), { memories } = etcfit.ecu, memory = new Float64Array(memories + 1);
    const seen = (volts, time) => {
      u.voltage1 = volts;
      u.time = time;
      model.read(values, x, u, read);
      return read[0];
    };
    const sees = { wanted: start, position: seen(0, 0), ahead: 0 }, filter = { shown: 0, before: 0, now: 0 }, shown = new Float64Array(1);
    etcfit.ecu.begin(gains, ecu, start, memory);
    let rate = 0;
    const path = { t: [], setpoint: [], share: [], volts: [], current: [] };
    for (let n = 0; n < ticks; n++) {
      const t = n * ecu.period, share = between(t, loop.setpoint.times, loop.setpoint.shares), wanted = angle(share);
      rate = (ecu.filter * rate + wanted - sees.wanted) / (ecu.filter + ecu.period);
      sees.wanted = wanted;
      sees.ahead = (loop.bias ? between(wanted, loop.bias.angles, loop.bias.volts) : 0) + moving(loop.sliding, rate);
      etcfit.ecu.tick(gains, ecu, memory, sees, memory);
      const volts = memory[memories]; // a tick leaves it behind what the PID remembers
      sent.unshift(volts);
      sent.pop();
      path.t.push(t);
      path.setpoint.push(share);
      path.share.push((x[1] - body.lower) / span);
      path.volts.push(volts);
      path.current.push(x[0]);
      for (let k = 0; k < parts; k++) {
        const mean = sent.reduce((sum, each, m) => sum + weights[k][m] * each, 0), begin = t + k * dt, end = begin + dt;
        filter.shown = sees.position;
        filter.before = seen(volts, begin);
        u.voltage0 = u.voltage1 = mean;
        u.time = end;
        model.advance(values, x, u, x);
        filter.now = seen(volts, end);
        etcfit.ecu.lag(dt / ecu.lag, filter, shown);
        sees.position = shown[0];
      }
      if (!Number.isFinite(x[1])) return null;
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
