// The page's own scripts in node: reads {kind, ...} as JSON, writes what the page would have computed.
"use strict";
const fs = require("fs"), path = require("path");
const reporting = path.join(__dirname, "../../../etcfit/reporting");
for (const name of ["effects.js", "stepper.js", "trace_run.js", "loop_run.js"]) require(path.join(reporting, "interactive/page", name));
require(path.join(reporting, "standalone/assets/decode.js"));
const etcfit = globalThis.etcfit, asked = JSON.parse(fs.readFileSync(0, "utf8"));

function trace({ sim, effects, values, instants }) {
  const begun = performance.now(), path = etcfit.runTrace(etcfit.excitation(sim), effects, values);
  const took = performance.now() - begun, out = { points: path.t.length, ms: took };
  for (const name of ["current", "position", "emf", "motor_speed"]) out[name] = etcfit.onto(path.t, path[name], instants);
  return out;
}

function loop({ loop, effects, values, gains, until }) {
  const begun = performance.now(), path = etcfit.runLoop(loop, effects, values, gains, until);
  return { ...path, ms: performance.now() - begun, figures: etcfit.judge(path, loop.levels) };
}

const work = { trace, loop, effects: () => Object.keys(etcfit.EFFECTS) };
process.stdout.write(JSON.stringify(asked.map((each) => work[each.kind](each))));
