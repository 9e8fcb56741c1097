"use strict";
/* The stepper of etcfit/model/stepper.py: two-stage L-stable SDIRK, linear-implicit in the smooth part, dry friction as
   a set-valued law solved exactly inside each stage. Slopes of the balances are taken by central differences, which
   keeps one formula an effect; what they are off by is far below the error of a step. */
(function (etcfit) {
  const GAMMA = 1 - 1 / Math.sqrt(2), OVERSHOOT = (1 - GAMMA) / GAMMA;
  const APART = 0.02; // torque of a motor that leaves the teeth of a resting plate, N m
  const NUDGE = { i: 1e-5, theta: 1e-6, omega: 1e-4, z: 1e-6 }; // A, rad, rad/s and of a memory

  const soft = (value, threshold) => Math.max(value - threshold, 0) + Math.min(value + threshold, 0);
  const between = (start, stage) => start + OVERSHOOT * (stage - start);

  /* A throttle body of these effects, those that need the gear's load last, with these values (SI by symbol). */
  class Plant {
    constructor(names, values) {
      this.values = values;
      this.z0 = [];
      const known = names.filter((name) => etcfit.EFFECTS[name]);
      this.parts = known.map((name) => {
        const effect = etcfit.EFFECTS[name], at = this.z0.length;
        this.z0.push(...(effect.z0 ?? []));
        return { add: effect.add, at, loaded: Boolean(effect.loaded) };
      });
      this.free = this.parts.filter((part) => !part.loaded);
      this.loaded = this.parts.filter((part) => part.loaded);
      this.c = { dz: new Float64Array(this.z0.length) };
    }

    /* The sum of all effects at state x, memories z and inputs u; overwritten by the next call. */
    contributions(x, z, u) {
      const c = this.c;
      c.torque = c.drive = c.friction = c.voltage = c.inertia = c.inductance = c.restitution = 0;
      c.position = c.current = c.input_delay = c.current_delay = 0;
      c.play = c.toothDamping = c.toothRestitution = 0;
      c.lower = -Infinity;
      c.upper = Infinity;
      c.dz.fill(0);
      for (const part of this.free) part.add(this.values, x, z, u, c, part.at);
      if (this.loaded.length) {
        u.motor = c.drive + u.torque;
        u.external = c.torque;
        for (const part of this.loaded) part.add(this.values, x, z, u, c, part.at);
      }
      return c;
    }

    /* How late the input acts and the current is logged, s. */
    delays() {
      const u = { voltage: 0, torque: 0, plate: 1, series: 0, gear_ratio: 1, lower: 0, upper: 1, motor: 0, external: 0 };
      const c = this.contributions({ i: 0, theta: 0, omega: 0 }, this.z0, u);
      return { input: c.input_delay, current: c.current_delay };
    }

    _balance(x, z, u) {
      const c = this.contributions(x, z, u);
      this.torque = c.torque + c.drive + u.torque;
      this.voltage = c.voltage + u.voltage;
    }

    _slope(x, z, u, name, out) {
      const nudge = NUDGE[name], here = x[name];
      x[name] = here + nudge;
      this._balance(x, z, u);
      const torque = this.torque, voltage = this.voltage;
      x[name] = here - nudge;
      this._balance(x, z, u);
      x[name] = here;
      out.torque[name] = (torque - this.torque) / (2 * nudge);
      out.voltage[name] = (voltage - this.voltage) / (2 * nudge);
    }

    /* Solve x = base + a f(x), dry friction and resting contact included. */
    _stage(base, guess, z, u, a, contact) {
      const at = { ...guess }, s = { torque: {}, voltage: {} };
      for (const name of ["i", "theta", "omega"]) this._slope(at, z, u, name, s);
      this._balance(at, z, u);
      const { inertia, inductance, friction } = this.c, b = a / inductance, T = s.torque, V = s.voltage;
      const share = 1 - b * V.i;
      const perSpeed = u.circuit * b * (V.theta * a + V.omega) / share;
      const mass = inertia - a * (T.i * perSpeed + T.theta * a + T.omega);
      const torqueAt = this.torque - T.i * guess.i - T.theta * guess.theta - T.omega * guess.omega;
      const voltageAt = this.voltage - V.i * guess.i - V.theta * guess.theta - V.omega * guess.omega;
      const still = u.circuit * (base.i + b * (voltageAt + V.theta * base.theta)) / share;
      const rhs = inertia * base.omega + a * (torqueAt + T.i * still + T.theta * base.theta);
      let omega = u.mobile * soft(rhs, a * friction) / mass;
      if ((contact.onLower && omega < 0) || (contact.onUpper && omega > 0)) omega = 0;
      return { i: still + perSpeed * omega, theta: base.theta + a * omega, omega };
    }

    /* z = base + a dz(x, z), linear-implicit in each memory's own decay. */
    _memory(base, guess, x, u, a) {
      if (!base.length) return base;
      const rate = Float64Array.from(this.contributions(x, guess, u).dz);
      const up = Float64Array.from(this.contributions(x, guess.map((g) => g + NUDGE.z), u).dz);
      const down = this.contributions(x, guess.map((g) => g - NUDGE.z), u).dz;
      return base.map((b, k) => {
        const slope = (up[k] - down[k]) / (2 * NUDGE.z);
        return (b + a * (rate[k] - slope * guess[k])) / (1 - a * slope);
      });
    }

    /* One step of h (s): `at(fraction)` fills and returns the inputs there. Returns state and memories at its end. */
    step(x, z, h, at) {
      const a = GAMMA * h;
      let u = at(GAMMA);
      const contact = touched(x, u, this.contributions(x, z, u), h), { plate } = u;
      if (contact.alone) u.plate = 0;
      const zEarly = this._memory(z, z, x, u, a);
      const first = this._stage(x, x, zEarly, u, a, contact);
      const z1 = this._memory(z, zEarly, first, u, a);
      const zBase = z.map((each, k) => between(each, z1[k]));
      const rests = { onLower: contact.onLower && first.theta <= contact.rest,
        onUpper: contact.onUpper && first.theta >= contact.upper };
      u = at(1);
      if (contact.alone) u.plate = 0;
      const zLate = this._memory(zBase, z1, first, u, a);
      const base = { i: between(x.i, first.i), theta: between(x.theta, first.theta), omega: between(x.omega, first.omega) };
      const second = this._stage(base, first, zLate, u, a, rests);
      const z2 = this._memory(zBase, zLate, second, u, a);
      u.plate = plate;
      return { x: clip(x, second, contact), z: z2 };
    }
  }

  /* The stops, and whether the plate rests on one; where the motor of a gear with play turns by itself, its ends. */
  function touched(x, u, c, h) {
    const there = c.play > 0 && u.plate > 0.5;
    const away = x.theta < c.lower || x.omega < 0 || c.drive + u.torque < -APART;
    const alone = there && x.theta <= c.lower && away;
    const lower = there ? c.lower - c.play : c.lower, upper = alone ? c.lower : c.upper, rest = alone ? lower : c.lower;
    const { restitution, toothDamping, toothRestitution } = c, fastest = h > 0 ? c.play / h : c.play;
    return { lower, upper, rest, there, alone, fastest, restitution, toothDamping, toothRestitution,
      onLower: x.theta <= rest, onUpper: !alone && x.theta >= upper };
  }

  /* A new impact: angle to the stop, speed to zero, or to the share that the stop or the teeth give back. */
  function clip(before, x, at) {
    const within = (back) => (Math.abs(back) < at.fastest ? back : 0);
    const lasts = (back, rests) => (!rests && Math.abs(back) > 2 * Math.abs(x.omega - before.omega) ? back : 0);
    const back = -at.restitution * x.omega;
    let omega = x.omega;
    if (x.theta < at.lower && x.omega < 0) {
      const down = at.there ? within(-x.omega / (1 + at.toothDamping * Math.abs(x.omega))) : back;
      omega = lasts(down, at.onLower);
    }
    if (x.theta > at.upper && x.omega > 0) {
      omega = lasts(at.alone ? within(-at.toothRestitution * x.omega) : back, at.onUpper);
    }
    return { i: x.i, theta: Math.min(Math.max(x.theta, at.lower), at.upper), omega };
  }

  etcfit.Plant = Plant;
})(globalThis.etcfit ??= {});
