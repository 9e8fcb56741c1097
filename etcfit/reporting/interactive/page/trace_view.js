"use strict";
/* One trace: verdict and cure, its channels with both models, what torque is missing, and the simulation of now. */
(function (etcfit) {
  const { element, short, words } = etcfit;
  const AGREES = 0.01; // of a channel's span, beyond which the page warns that its own simulation is not etcfit's

  class TraceView {
    /* data: of the page; values(): of the parameters now, or null where they are the fitted ones. */
    constructor(data, values) {
      this.data = data;
      this.values = values;
      this.curves = [
        { name: "measured", label: "measured", colour: "measured" },
        ...(data.diagnosed ? [{ name: "before", label: "before (first fit)", colour: "before", dash: [7, 4] }] : []),
        { name: "after", label: data.diagnosed ? "after (diagnosis)" : "fitted", colour: "after" },
        { name: "now", label: "now (sliders)", colour: "now", dash: [2, 3] },
      ];
      this.shown = { drive: true, ...Object.fromEntries(this.curves.map(({ name }) => [name, true])) };
      this.stack = new etcfit.Stack(document.getElementById("charts"), (entry, k) => this.read_off(entry, k));
      this.key();
      for (const button of document.querySelectorAll("[data-zoom]")) button.addEventListener("click", () => this.stack.zoom(button.dataset.zoom));
    }

    key() {
      document.getElementById("curves").replaceChildren(...this.curves.map(({ name, label, colour, dash }) => {
        const box = element("input", { type: "checkbox", checked: this.shown[name] });
        box.addEventListener("change", () => { this.shown[name] = box.checked; this.stack.toggle(name, box.checked); });
        const style = name === "measured" ? "dotted" : dash ? (dash[0] < 4 ? "dotted" : "dashed") : "solid";
        const swatch = element("span", { class: "swatch", "aria-hidden": "true" });
        swatch.style.borderTop = `${name === "measured" ? 5 : 3}px ${style} ${etcfit.colour(colour)}`;
        return element("label", {}, box, swatch, label);
      }));
    }

    show(k) {
      this.trace = this.data.traces[k];
      const { trace } = this;
      this.sim = etcfit.excitation(trace.sim);
      document.getElementById("trace-title").textContent = `${trace.file} · ${trace.held_out ? "held out" : "fitted"}`;
      this.verdict();
      this.draw();
      this.update();
      document.getElementById("simulation").textContent = "";
      requestAnimationFrame(() => setTimeout(() => { if (this.trace === trace) this.check_simulation(); })); // once it is seen
    }

    verdict() {
      const { trace } = this, { sign } = etcfit.LIGHTS[trace.light];
      const rows = trace.channels.map((c) => `${words(c.name)} ${c.rms_before === null ? "" : `${short(c.rms_before)} → `}${short(c.rms_after)} σ`);
      const cures = element("div", { class: `cure ${trace.light}` },
        element("p", {}, element("b", { class: trace.light }, `${sign} ${trace.word}.`), ...trace.says.map((each) => ` ${each}`)),
        element("p", { class: "more" }, `Free-run error, rms, in times the sensor's noise σ: ${rows.join(", ")}.`));
      if (trace.cures.length) cures.append(element("ul", {}, ...trace.cures.map((cure) => element("li", {}, ...etcfit.with_code(cure)))));
      document.getElementById("verdict").replaceChildren(cures);
    }

    draw() {
      const { trace, stack } = this, t = etcfit.floats(trace.t), zoomed = stack.zoomed;
      stack.clear();
      this.t = t;
      this.panels = trace.channels.map((channel) => {
        const at = (pack) => (pack === null ? t.map(() => null) : etcfit.levels(pack));
        const values = { measured: at(channel.measured), before: at(channel.before), after: at(channel.after), now: t.map(() => null) };
        const entry = stack.add({
          title: words(channel.name), label: `${words(channel.name)} [${channel.unit}]`, t,
          describe: `${words(channel.name)} of ${trace.file} over time in ${channel.unit}: measured and simulated; ` +
            `free-run error ${short(channel.rms_after)} times the sensor's noise. Arrow keys move, plus and minus zoom, 0 shows all.`,
          series: this.curves.map((curve) => ({ ...curve, values: values[curve.name], show: this.shown[curve.name],
            dots: curve.name === "measured" && trace.whole, width: { measured: 1, before: 2, after: 1.5, now: 2 }[curve.name] })),
        });
        const error = stack.add({
          title: `${words(channel.name)}: measured − simulated`, label: "error [σ]", t, low: true,
          describe: `Error of the ${words(channel.name)} of ${trace.file} over time, in standard deviations of the sensor's noise.`,
          series: this.curves.filter(({ name }) => name !== "measured").map((curve) => ({ ...curve, dash: undefined, show: this.shown[curve.name],
            values: channel[`error_${curve.name}`] ? etcfit.levels(channel[`error_${curve.name}`]) : t.map(() => null), width: 1 })),
        });
        return { channel, entry, error, ...values };
      });
      this.add_drive();
      for (const missing of trace.missing) {
        stack.add({
          title: `${missing.name}: what the model lacks along the measured angle`,
          label: `${missing.name.split(" ")[1]} [${missing.unit}]`, t, low: true, describe: `${missing.name} of ${trace.file} over time in ${missing.unit}, with the first and with the final model.`,
          series: this.curves.filter(({ name }) => missing[name]).map((curve) => ({ ...curve, dash: undefined, values: etcfit.levels(missing[curve.name]), show: this.shown[curve.name], width: 1 })),
        });
      }
      if (zoomed && zoomed[1] <= t[t.length - 1] && this.drawn === trace) stack.show(...zoomed);
      this.drawn = trace;
    }

    /* What drove the trace, below its channels; none where nothing did. */
    add_drive() {
      const { sim, trace } = this;
      if (!sim || !sim.v.some((level) => level !== 0)) return;
      const [name, unit] = sim.boundary.circuit ? ["voltage", "V"] : ["torque", "N m"];
      this.stack.add({
        title: `${name} that drove it`, label: `${name} [${unit}]`, t: sim.t, low: true,
        describe: `${name} that drove ${trace.file} over time in ${unit}.`,
        series: [{ name: "drive", label: name, colour: "accent", values: sim.v }],
      });
    }

    /* One channel of a simulated path at the instants that are drawn, in the unit that is shown. */
    drawn_as(path, channel) {
      const values = path[channel.name].map((value) => (value - channel.origin) / channel.size);
      return this.trace.whole ? etcfit.onto(path.t, values, this.t) : extremes(path.t, values, this.t);
    }

    run(values) { return this.sim && etcfit.runTrace(this.sim, values); }

    /* What the page's own simulation is worth in this trace, said before anybody moves a slider. */
    check_simulation() {
      const note = document.getElementById("simulation"), { plant } = this.data;
      const left_out = [...plant.left_out, ...plant.others.filter((name) => !this.baked(name))];
      const says = [];
      let off = Infinity;
      if (!this.sim) says.push(this.trace.why_not);
      else {
        const path = this.run(plant.values);
        off = path ? Math.max(...this.panels.map(({ channel, after }) => difference(this.drawn_as(path, channel), after))) : Infinity;
        says.push(path
          ? `At the fitted values this page's own simulation lies ${short(100 * off, 2)} % of the span (rms) from etcfit's.`
          : "This page's own simulation fails in this trace.");
        if (off >= AGREES && path) says.push("So far off, what a slider does here says little.");
        if (this.sim.lacks.length) says.push(`It leaves out: ${this.sim.lacks.join(", ")}.`);
      }
      if (left_out.length) says.push(`The fitted model has what this page cannot simulate: ${left_out.map(words).join(", ")}.`);
      if (plant.effects.some((name) => name === "stop_bounce")) says.push("Rebounds off a stop are as sensitive as in a car: times of later ones scatter.");
      note.textContent = says.join(" ");
      note.classList.toggle("warn", left_out.length > 0 || !this.sim || !(off < AGREES));
    }

    /* Effects of the rig whose part in input and reading the trace's own data have in them. */
    baked(name) { return /^(series_resistance|channel_gain|channel_offset|channel_drift|sensor_end_points|gear_ratio|edge_phase)/.test(name); }

    update() {
      const values = this.values(), out = document.getElementById("misfit");
      const path = values && this.run(values);
      const said = [];
      for (const { channel, entry, error, measured, after } of this.panels) {
        const now = path ? this.drawn_as(path, channel) : this.t.map(() => null);
        const off = (value, k) => (value === null || now[k] === null ? null : (value - now[k]) / channel.sigma);
        this.stack.set(entry, "now", now);
        if (this.trace.whole) this.stack.set(error, "now", measured.map(off));
        if (path) said.push(`${words(channel.name)} ${short(rms(measured, after) / channel.sigma)} → ${short(rms(measured, now) / channel.sigma)} σ`);
      }
      out.textContent = values && !this.sim ? this.trace.why_not : values && !path ? "These values cannot be simulated." : said.length ? `Distance from the data: ${said.join(", ")}` : "";
    }

    read_off(entry, k) {
      if (!entry || k === null || k === undefined) return;
      const seen = entry.series.filter((each) => each.values[k] !== null && this.shown[each.name]).map((each) => `${each.label} ${short(each.values[k], 4)}`);
      document.getElementById("readout").textContent = `${entry.label.split(" [")[0]} at ${short(entry.t[k], 5)} s: ${seen.join(", ")} (${entry.label.split("[")[1].replace("]", "")})`;
    }
  }

  /* Least and most of a path in each bin, whose two points lie a quarter and three quarters into it. */
  function extremes(t, values, points) {
    const out = new Array(points.length).fill(null), at = etcfit.onto(t, values, points);
    let k = 0;
    for (let b = 0; b + 1 < points.length; b += 2) {
      const quarter = 0.5 * (points[b + 1] - points[b]), begin = points[b] - quarter, end = points[b + 1] + quarter;
      let [first, last] = [at[b], at[b + 1]], when = [points[b], points[b + 1]];
      let low = first <= last ? { v: first, t: when[0] } : { v: last, t: when[1] };
      let high = first <= last ? { v: last, t: when[1] } : { v: first, t: when[0] };
      while (k < t.length && t[k] < begin) k++;
      for (let j = k; j < t.length && t[j] <= end; j++) {
        if (values[j] < low.v) low = { v: values[j], t: t[j] };
        if (values[j] > high.v) high = { v: values[j], t: t[j] };
      }
      [out[b], out[b + 1]] = low.t <= high.t ? [low.v, high.v] : [high.v, low.v];
    }
    return out;
  }

  function rms(one, other) {
    let sum = 0, n = 0;
    for (let k = 0; k < one.length; k++) if (one[k] !== null && other[k] !== null) { sum += (one[k] - other[k]) ** 2; n++; }
    return Math.sqrt(sum / Math.max(1, n));
  }

  /* rms difference over the span of the second. */
  function difference(one, other) {
    const seen = other.filter((value) => value !== null);
    let low = Infinity, high = -Infinity;
    for (const value of seen) { if (value < low) low = value; if (value > high) high = value; }
    return high > low ? rms(one, other) / (high - low) : 0;
  }

  etcfit.TraceView = TraceView;
})(globalThis.etcfit ??= {});
