"use strict";
/* The closed loop: the gains that were designed, and those of the sliders, on the page's setpoint. */
(function (etcfit) {
  const { element, short } = etcfit;
  const FIGURES = { overshoot_pct: "overshoot [%]", settling_s: "settling time [s]", steady_state_error_pct: "steady-state error [%]", rmse_pct: "RMSE [%]" };
  const UNITS = { Kp: "V/rad", Ki: "V/(rad s)", Kd: "V s/rad" };
  const MEANINGS = { Kp: "proportional", Ki: "integral", Kd: "derivative" };

  class LoopView {
    /* data: of the page; values(): of the plant's parameters now, or null where they are the fitted ones. */
    constructor(data, values) {
      this.data = data;
      this.values = values;
      const host = document.getElementById("loop-body");
      if (!data.loop) {
        host.append(element("p", {}, "No gains have been sought: ", element("code", {}, "etcfit design RUN"), "."));
        return;
      }
      const { loop } = data;
      this.until = element("select", {}, new Option("the paper's trapezoid", String(loop.first)),
        ...(loop.setpoint.times.at(-1) > loop.first + 1e-6 ? [new Option(`all scenarios, ${short(loop.setpoint.times.at(-1))} s`, String(loop.setpoint.times.at(-1)))] : []));
      this.until.addEventListener("change", () => this.redraw());
      const back = element("button", { type: "button" }, "Back to the designed gains");
      back.addEventListener("click", () => this.sliders.back());
      const sliders = element("div", { class: "sliders" }), charts = element("div", { id: "loop-charts" });
      this.figures = element("div", { class: "figures", "aria-live": "polite" });
      const lacks = [...(loop.noise ? ["the noise of the position sensor"] : []), ...data.plant.left_out.map(etcfit.words)];
      host.append(
        element("p", { class: "soft" }, `Rule ${etcfit.words(loop.rule)}. etcfit's own discrete PID at ${short(1e3 * loop.ecu.period)} ms around the model with the parameters as their sliders stand.${lacks.length ? ` Left out: ${lacks.join(", ")}.` : ""}`),
        element("div", { class: "row" }, element("label", {}, "Setpoint ", this.until), back), sliders, this.figures, charts);
      this.sliders = new etcfit.Sliders(sliders, Object.entries(loop.gains).map(([symbol, row]) => ({ ...row, symbol, unit: UNITS[symbol], meaning: MEANINGS[symbol] })), () => this.soon());
      this.soon = etcfit.onceAFrame(() => this.update());
      this.stack = new etcfit.Stack(charts);
      this.designed = Object.fromEntries(Object.entries(loop.gains).map(([name, { value }]) => [name, value]));
    }

    run(values, gains) {
      const path = etcfit.runLoop(this.data.loop, values, gains, Number(this.until.value));
      return path && { ...path, share: path.share.map((x) => 100 * x), setpoint: path.setpoint.map((x) => 100 * x), judged: etcfit.judge(path, this.data.loop.levels) };
    }

    redraw() {
      if (!this.data.loop) return;
      this.was = this.run(this.data.plant.values, this.designed);
      this.stack.clear();
      if (!this.was) { this.figures.textContent = "The designed loop cannot be simulated here."; return; }
      const { t, setpoint, share, volts } = this.was, nothing = t.map(() => null);
      const curves = (was) => [{ name: "designed", label: "designed", colour: "after", values: was, width: 1.5 },
                               { name: "now", label: "now", colour: "now", dash: [2, 3], values: nothing, width: 2 }];
      this.panels = {
        share: this.stack.add({ title: "position: setpoint (grey), designed (solid), now (dotted)", label: "share of travel [%]", t, describe: "Position of the closed loop in per cent of the travel: setpoint, with the designed gains, and with those of the sliders.",
          series: [{ name: "setpoint", label: "setpoint", colour: "setpoint", dash: [6, 4], values: setpoint, width: 1.5 }, ...curves(share)] }),
        volts: this.stack.add({ title: "voltage of the ECU", label: "voltage [V]", t, describe: "Voltage that the ECU puts out, with the designed gains and with those of the sliders.", series: curves(volts) }),
      };
      this.update();
    }

    update() {
      if (!this.data.loop || !this.was) return;
      const values = this.values(), moved = values !== null || !this.sliders.untouched;
      const now = moved ? this.run(values ?? this.data.plant.values, this.sliders.values) : null;
      for (const name of ["share", "volts"]) this.stack.set(this.panels[name], "now", now ? now[name] : this.was.t.map(() => null));
      const asked = this.data.loop.requirements, row = (name, judged) =>
        element("tr", {}, element("th", { scope: "row" }, name), ...Object.keys(FIGURES).map((key) => element("td", {}, short(judged[key]))));
      this.figures.replaceChildren(element("table", {}, element("caption", {}, "On the trapezoid, the worst of both edges"),
        element("tr", {}, element("td", {}), ...Object.values(FIGURES).map((name) => element("th", { scope: "col" }, name))),
        row("designed", this.was.judged), ...(moved ? [now ? row("now", now.judged) : element("tr", {}, element("th", { scope: "row" }, "now"), element("td", { colspan: "4" }, "unstable: it cannot be simulated"))] : []),
        element("tr", {}, element("th", { scope: "row" }, "required, at most"), ...Object.keys(FIGURES).map((key) => element("td", {}, asked[key] === undefined ? "–" : short(asked[key]))))));
    }
  }

  etcfit.LoopView = LoopView;
})(globalThis.etcfit ??= {});
