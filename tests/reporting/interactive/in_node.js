// The page's own scripts in node: reads {script, asked: [{kind, ...}]} as JSON, writes what the page would have computed.
"use strict";
const fs = require("fs"), path = require("path"), vm = require("vm");
const reporting = path.join(__dirname, "../../../etcfit/reporting"), { script, asked } = JSON.parse(fs.readFileSync(0, "utf8"));
vm.runInThisContext(script);
for (const name of ["trace_run.js", "loop_run.js"]) require(path.join(reporting, "interactive/page", name));
require(path.join(reporting, "assets/decode.js"));
const etcfit = globalThis.etcfit;

function trace({ sim, values, instants }) {
  const path = etcfit.runTrace(etcfit.excitation(sim), values), out = {};
  for (const name of ["current", "position", "emf", "motor_speed"]) out[name] = etcfit.onto(path.t, path[name], instants);
  return out;
}

function loop({ loop, values, gains, until }) {
  const path = etcfit.runLoop(loop, values, gains, until);
  return { ...path, figures: etcfit.judge(path, loop.levels) };
}

/* One step, what is read after it, and the delays: of each row of parameters, state and inputs. */
function steps({ p, x, u }) {
  const { model } = etcfit, finite = (row) => ({ ...row, lower: row.lower ?? -Infinity, upper: row.upper ?? Infinity });
  return x.map((state, k) => {
    const inputs = finite(u[k]), after = state.slice(), read = [], late = [];
    model.advance(p[k], after, inputs, after);
    model.read(p[k], after, inputs, read);
    model.delays(p[k], late);
    return [...after, ...read, ...late];
  });
}

const stops = ({ sim }) => { const { lower, upper } = etcfit.excitation(sim).boundary; return [String(lower), String(upper)]; };
const work = { trace, loop, steps, stops };
process.stdout.write(JSON.stringify(asked.map((each) => work[each.kind](each))));
