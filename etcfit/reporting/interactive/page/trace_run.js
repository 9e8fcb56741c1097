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

  /* Path of a trace: instants and what each channel shows there.
     sim: as in the page's data; values: SI by symbol; effects: names. */
  etcfit.runTrace = function (sim, effects, values) {
    const plant = new etcfit.Plant(effects, values), delays = plant.delays();
    const input = new Input(sim, delays.input), end = sim.t[sim.t.length - 1];
    const u = { ...sim.boundary, voltage: 0, torque: 0, mobile: 1, motor: 0, external: 0 };
    const drives = u.circuit ? "voltage" : "torque", span = sim.span;
    let [i, theta, omega] = sim.start, z = [...plant.z0], steps = 0;
    const first = plant.contributions({ i, theta, omega }, z, u);
    let x = { i, theta: Math.min(Math.max(theta, first.lower), first.upper), omega };
    const path = { t: [], i: [], theta: [], omega: [], position: [], current: [], emf: [], motor_speed: [] };

    function record(t, level) {
      u[drives] = level;
      const c = plant.contributions(x, z, u), turns = u.gear_ratio * x.omega;
      path.t.push(t);
      path.position.push(x.theta + c.position);
      path.current.push(x.i + c.current);
      path.emf.push(values.K_b * turns);
      path.motor_speed.push(turns);
    }

    record(sim.t[0], input.v[0]);
    const longest = LONGEST * (end - sim.t[0]);
    let h = 1e-4;
    for (const [k, begin, stop] of pieces(input, sim)) {
      u.mobile = begin >= sim.release ? 1 : 0;
      let t = begin;
      while (stop - t > 1e-12) {
        const left = stop - t;
        let long = h >= left ? left : h > 0.5 * left ? 0.5 * left : h;
        for (;;) {
          const at = (from, length) => (fraction) => {
            u[drives] = input.at(k, from + fraction * length);
            return u;
          };
          const half = 0.5 * long;
          const whole = plant.step(x, z, long, at(t, long));
          const early = plant.step(x, z, half, at(t, half));
          const late = plant.step(early.x, early.z, half, at(t + half, half));
          const wrong = Math.max(
            Math.abs(whole.x.i - late.x.i) / span.i,
            Math.abs(whole.x.theta - late.x.theta) / span.theta,
            LASTING * Math.abs(whole.x.omega - late.x.omega) / span.theta,
          ) / TOLERANCE;
          const bent = 0.25 * Math.max(
            Math.abs(early.x.i - 0.5 * (x.i + late.x.i)) / span.i,
            Math.abs(early.x.theta - 0.5 * (x.theta + late.x.theta)) / span.theta,
            Math.abs(early.x.omega - 0.5 * (x.omega + late.x.omega)) / span.omega,
          ) / STRAIGHT;
          if (!Number.isFinite(wrong + bent) || (steps += 3) > MOST) return null;
          const grow = 0.9 * Math.min(Math.cbrt(1 / Math.max(wrong, 1e-9)), Math.sqrt(1 / Math.max(bent, 1e-9)));
          if ((wrong <= 1 && bent <= 1) || long <= SHORTEST) {
            x = early.x; z = early.z;
            record(t + half, input.at(k, t + half));
            x = late.x; z = late.z;
            t += long;
            record(t, input.at(k, t));
            const next = long * Math.min(Math.max(grow, 0.3), 4);
            h = Math.max(long < h && grow >= 1 ? Math.max(h, next) : next, SHORTEST); // one cut short tells no limit
            h = Math.min(h, Math.max(longest, SHORTEST));
            break;
          }
          h = long = Math.max(SHORTEST, long * Math.min(Math.max(grow, 0.2), 0.7));
        }
      }
    }
    if (delays.current > 0) {
      const behind = path.t.map((t) => t - delays.current);
      path.current = etcfit.onto(path.t, path.current, behind);
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
