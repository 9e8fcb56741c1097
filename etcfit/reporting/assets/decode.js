"use strict";
/* The numbers of the page's data, as etcfit/reporting/packed.py wrote them. */
(function (etcfit) {
  const NOTHING = -32768;

  function bytes(text) {
    const raw = atob(text), out = new Uint8Array(raw.length);
    for (let k = 0; k < raw.length; k++) out[k] = raw.charCodeAt(k);
    return out.buffer;
  }

  /* 32-bit floats from an origin on. */
  etcfit.floats = (pack) => Array.from(new Float32Array(bytes(pack.f32)), (value) => pack.from + value);

  /* 16-bit levels; null where there is nothing. */
  etcfit.levels = (pack) =>
    Array.from(new Int16Array(bytes(pack.i16)), (q) => (q === NOTHING ? null : pack.zero + pack.step * q));

  /* Figures in a typed array, NaN where there is nothing: for many thousands. */
  etcfit.typed = (pack) => (pack.f32 ? new Float32Array(bytes(pack.f32))
    : Float32Array.from(new Int16Array(bytes(pack.i16)), (q) => (q === NOTHING ? NaN : pack.zero + pack.step * q)));

  /* Whole numbers in a typed array. */
  etcfit.codes = (pack) => new Int32Array(bytes(pack.i32));

  /* What drove a trace, ready for `runTrace`; null where the page cannot simulate it. JSON has null for what is infinite. */
  etcfit.excitation = (sim) =>
    sim && { ...sim, t: etcfit.floats(sim.t), v: etcfit.floats(sim.v), release: sim.release ?? Infinity,
      boundary: { ...sim.boundary, lower: sim.boundary.lower ?? -Infinity, upper: sim.boundary.upper ?? Infinity } };
})(globalThis.etcfit ??= {});
