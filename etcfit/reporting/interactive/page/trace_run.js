"use strict";
/* A trace simulated again with other values: the plant under the trace's own input, in steps as short as it needs.

   Each step is taken once whole and once in halves; the difference, held against 1e-5 of what the channels span,
   chooses the next one's length. */
(function (etcfit) {
  const TOLERANCE = 1e-5; // of a channel's span, a step
  const STRAIGHT = 2e-4; // of a channel's span: what a straight line between two points may miss
  const LASTING = 0.03; // s, for how long an error in speed moves the angle
  const SHORTEST = 1e-5; // s, at an impact, which no step makes smooth
  const LONGEST = 1 / 2500; // of the trace: both halves of a longer step could miss a narrow corner
  const MOST = 300000; // steps, lest a slider stops the page
  const CHANNELS = ["position", "current", "emf", "motor_speed"]; // in the order in which the model reads them
  const I = 0, THETA = 1, OMEGA = 2; // of a state, ahead of the memories

  /* The input: straight between its corners, jumps where two of them share an instant; acting `late` s later. */
  class Input {
    constructor(sim, late) {
      this.t = late > 0 ? [sim.t[0], ...Array.from(sim.t, (t) => t + late)] : sim.t;
      this.v = late > 0 ? [sim.v[0], ...sim.v] : sim.v;
    }

    /* Level at an instant of piece k, which reaches from corner k to corner k + 1. */
    at(k, t) {
      const span = this.t[k + 1] - this.t[k];
      return span > 0 ? this.v[k] + (this.v[k + 1] - this.v[k]) * (t - this.t[k]) / span : this.v[k + 1];
    }
  }

  /* Instants that no step may straddle, with the piece of the input that follows each. */
  function pieces(input, sim) {
    const end = sim.t[sim.t.length - 1], out = [];
    for (let k = 0; k + 1 < input.t.length; k++) {
      const begin = input.t[k], stop = Math.min(input.t[k + 1], end);
      if (stop > begin) {
        if (sim.release > begin && sim.release < stop) out.push([k, begin, sim.release], [k, sim.release, stop]);
        else out.push([k, begin, stop]);
      }
    }
    return out;
  }

  /* Path of a trace: instants and what each channel shows there. sim: as in the page's data; values: SI by symbol. */
  etcfit.runTrace = function (sim, values) {
    const { model } = etcfit, delays = {}, seen = new Float64Array(CHANNELS.length), size = 3 + model.z0.length;
    model.delays(values, seen);
    [delays.input, delays.position, delays.current] = seen;
    const input = new Input(sim, delays.input), begun = sim.t[0], end = sim.t[sim.t.length - 1], { span } = sim;
    const u = { dt: 0, voltage0: 0, voltage1: 0, torque0: 0, torque1: 0, time: 0, mobile: 0, ...sim.boundary };
    const [from, to] = u.circuit ? ["voltage0", "voltage1"] : ["torque0", "torque1"];
    let x = Float64Array.of(...sim.start, ...model.z0), late = new Float64Array(size), steps = 0;
    const whole = new Float64Array(size), early = new Float64Array(size);
    const path = { t: [], ...Object.fromEntries(CHANNELS.map((name) => [name, []])) };

    /* A step from instant t on, of so many s, under levels of piece k. */
    function advance(x, t, length, k, out) {
      u.dt = length;
      u.time = t + length - begun;
      u[from] = input.at(k, t);
      u[to] = input.at(k, t + length);
      model.advance(values, x, u, out);
    }

    function record(t, x) {
      model.read(values, x, u, seen);
      path.t.push(t);
      for (let k = 0; k < seen.length; k++) path[CHANNELS[k]].push(seen[k]);
    }

    u.mobile = begun >= sim.release ? 1 : 0;
    u[from] = input.at(0, begun);
    model.first(values, x, u, late);
    x.set(late.subarray(0, model.z0.length), 3);
    advance(x, begun, 0, 0, x); // onto the stops
    record(begun, x);
    const longest = LONGEST * (end - begun);
    let h = 1e-4;
    for (const [k, begin, stop] of pieces(input, sim)) {
      u.mobile = begin >= sim.release ? 1 : 0;
      let t = begin;
      while (stop - t > 1e-12) {
        const left = stop - t;
        let long = h >= left ? left : h > 0.5 * left ? 0.5 * left : h;
        for (;;) {
          const half = 0.5 * long;
          advance(x, t, long, k, whole);
          advance(x, t, half, k, early);
          advance(early, t + half, half, k, late);
          const wrong = Math.max(
            Math.abs(whole[I] - late[I]) / span.i,
            Math.abs(whole[THETA] - late[THETA]) / span.theta,
            LASTING * Math.abs(whole[OMEGA] - late[OMEGA]) / span.theta,
          ) / TOLERANCE;
          const bent = 0.25 * Math.max(
            Math.abs(early[I] - 0.5 * (x[I] + late[I])) / span.i,
            Math.abs(early[THETA] - 0.5 * (x[THETA] + late[THETA])) / span.theta,
            Math.abs(early[OMEGA] - 0.5 * (x[OMEGA] + late[OMEGA])) / span.omega,
          ) / STRAIGHT;
          if (!Number.isFinite(wrong + bent) || (steps += 3) > MOST) return null;
          const grow = 0.9 * Math.min(Math.cbrt(1 / Math.max(wrong, 1e-9)), Math.sqrt(1 / Math.max(bent, 1e-9)));
          if ((wrong <= 1 && bent <= 1) || long <= SHORTEST) {
            u[to] = input.at(k, t + half);
            u.time = t + half - begun;
            record(t + half, early);
            t += long;
            u[to] = input.at(k, t);
            u.time = t - begun;
            record(t, late);
            [x, late] = [late, x];
            const next = long * Math.min(Math.max(grow, 0.3), 4);
            h = Math.max(long < h && grow >= 1 ? Math.max(h, next) : next, SHORTEST); // one cut short tells no limit
            h = Math.min(h, Math.max(longest, SHORTEST));
            break;
          }
          h = long = Math.max(SHORTEST, long * Math.min(Math.max(grow, 0.2), 0.7));
        }
      }
    }
    for (const channel of ["position", "current"]) {
      if (delays[channel] > 0) path[channel] = etcfit.onto(path.t, path[channel], path.t.map((t) => t - delays[channel]));
    }
    for (const [channel, [gain, zero]] of Object.entries(sim.readings))
      path[channel] = path[channel].map((value) => zero + gain * value);
    return path;
  };

  /* Values at other instants, straight between their own; both rising. */
  etcfit.onto = function (t, values, instants) {
    let k = 0;
    return Array.from(instants, (wanted) => {
      while (k + 2 < t.length && t[k + 1] < wanted) k++;
      const share = t[k + 1] > t[k] ? (wanted - t[k]) / (t[k + 1] - t[k]) : 1;
      return values[k] + Math.min(Math.max(share, 0), 1) * (values[k + 1] - values[k]);
    });
  };
})(globalThis.etcfit ??= {});
