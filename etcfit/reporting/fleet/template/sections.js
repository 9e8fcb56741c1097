"use strict";
/* Each section's charts: what is painted in them, and what their switches do. */
(function (etcfit) {
  const { element, short, symbol, unit, words, Panel, Points, Bars } = etcfit;
  const ELLIPSE = 2.4477; // sqrt of the 95 % quantile of chi-square with two degrees of freedom
  const DASH = [6, 4];
  const limits = (list, key) => list.filter((each) => each !== null).map((each) => ({ [key]: each, colour: "red", dash: DASH }));
  const counting = (count, from = 1) => Float64Array.from({ length: count }, (_, k) => k + from);

  /* Places of the units by rising value, those without one last. */
  function ranks(value) {
    const by = Array.from(value.keys()).sort((a, b) => (value[a] - value[b]) || (Number.isNaN(value[a]) ? 1 : Number.isNaN(value[b]) ? -1 : a - b));
    const rank = new Float64Array(value.length);
    by.forEach((k, i) => { rank[k] = i + 1; });
    return rank;
  }

  class Section {
    constructor(store, id) {
      this.store = store;
      this.host = document.getElementById(id);
      this.panels = [];
      if (this.host) this.draw();
    }

    clear() {
      for (const each of this.panels) each.gone();
      this.panels = [];
    }

    zoom(how) { for (const each of this.panels[0]?.how.group ? this.panels.slice(0, 1) : this.panels) each.zoom(how); }

    add(painter, how) { this.panels.push(new Panel(this.host, this.store, painter, how)); }
  }

  class Population extends Section {
    constructor(store) {
      super(store, "population-panels");
      for (const id of ["kind", "order"]) document.getElementById(id)?.addEventListener("change", () => this.draw());
    }

    draw() {
      this.clear();
      const sorted = document.getElementById("order").value === "sorted", shrunk = document.getElementById("kind").value === "shrunk";
      const group = sorted ? null : new Set();
      for (const each of this.store.data.symbols.filter((one) => one.known)) {
        const painter = this.painter(each, shrunk, sorted);
        const title = [...symbol(each.symbol), element("span", { class: "soft" }, this.caption(each))];
        this.add(painter, { title, describe: `${each.symbol} of every unit${this.caption(each)}`, unit: each.unit, group,
                            xLabel: sorted ? "unit, by value" : "unit, in order", height: 170 });
      }
    }

    caption(each) {
      if (each.shared) return ` one value for all: ${short(each.mean, 4)} ${unit(each.unit)}`;
      return each.mean === null ? "" : ` ${etcfit.both(each.mean, each.sd, each.unit)}`;
    }

    painter(each, shrunk, sorted) {
      const { store } = this, column = (name) => store.column(each[name]), y = column(shrunk ? "shrunk_value" : "value");
      const error = shrunk ? column("shrunk_stderr") : null;
      const [low, high] = shrunk ? [y.map((v, k) => v - 1.96 * error[k]), y.map((v, k) => v + 1.96 * error[k])] : [column("low"), column("high")];
      const known = each.mean !== null && !each.shared && each.sd > 0;
      const edges = known ? [-2, 2].map((sd) => ({ y: each.mean + sd * each.sd, colour: "ink", width: 1, dash: [2, 3] })) : [];
      return new Points(store, {
        x: sorted ? ranks(y) : counting(store.count), y, low, high,
        bands: known ? [[each.mean - 2 * each.sd, each.mean + 2 * each.sd]] : [],
        lines: [...(each.mean === null ? [] : [{ y: each.mean, colour: "ink" }]), ...edges, ...limits(each.limits, "y")],
        words: (k) => `${store.names[k]}: ${short(y[k], 4)} ${unit(each.unit)}`,
      });
    }
  }

  class Pair extends Section {
    constructor(store) {
      super(store, "pair");
      if (!this.host) return;
      const buttons = [...document.querySelectorAll("[data-pair]")];
      for (const button of buttons) button.addEventListener("click", () => this.choose(button, buttons));
      document.getElementById("kind")?.addEventListener("change", () => this.draw());
      const strength = (button) => Number(button.style.getPropertyValue("--r"));
      const first = buttons.reduce((best, each) => (strength(each) > strength(best) ? each : best), buttons[0]);
      if (first) this.choose(first, buttons);
    }

    choose(button, buttons) {
      for (const each of buttons) each.setAttribute("aria-pressed", String(each === button));
      this.pair = button.dataset.pair.split(",").map(Number);
      this.draw();
    }

    draw() {
      this.clear();
      if (!this.pair) return;
      const { symbols, matrix } = this.store.data.correlation, [j, i] = this.pair, r = matrix[i][j];
      const [a, b] = [i, j].map((k) => this.store.data.symbols.find((each) => each.symbol === symbols[k]));
      if (!a || !b) return;
      const kind = document.getElementById("kind")?.value === "shrunk" ? "shrunk_value" : "value";
      const x = this.store.column(a[kind]), y = this.store.column(b[kind]), curve = this.ellipse(a, b, r);
      const painter = new Points(this.store, {
        x, y, curves: curve ? [{ ...curve, colour: "after", width: 2 }] : [],
        range_x: etcfit.range([x, curve?.x ?? []], 0.04), range_y: etcfit.range([y, curve?.y ?? []], 0.04),
        words: (k) => `${this.store.names[k]}: ${short(x[k])}, ${short(y[k])}`,
      });
      const title = [...symbol(b.symbol), " over ", ...symbol(a.symbol), element("span", { class: "soft" }, ` correlation ${r.toFixed(2).replace("-", "−")}`)];
      this.add(painter, { title, describe: `${b.symbol} over ${a.symbol} of every unit, correlation ${r.toFixed(2)}`, xLabel: a.symbol, xUnit: a.unit,
                          yLabel: b.symbol, unit: b.unit, height: 340 });
    }

    ellipse(a, b, r) {
      if (!(a.sd > 0 && b.sd > 0)) return null;
      const angle = Float64Array.from({ length: 121 }, (_, k) => (2 * Math.PI * k) / 120), rest = Math.sqrt(Math.max(0, 1 - r * r));
      return { x: angle.map((t) => a.mean + ELLIPSE * a.sd * Math.cos(t)),
               y: angle.map((t) => b.mean + ELLIPSE * b.sd * (r * Math.cos(t) + rest * Math.sin(t))) };
    }
  }

  class Charts extends Section {
    constructor(store) {
      super(store, "chart-panels");
      if (!this.host) return;
      this.select = document.getElementById("chart");
      const { charts } = store.data;
      this.select.append(...charts.map((each, k) => new Option(each.symbol + (each.since.length ? ", drifts" : ""), String(k))));
      this.select.value = String(Math.max(0, charts.findIndex((each) => each.since.length)));
      this.select.addEventListener("change", () => this.draw());
      this.draw();
    }

    draw() {
      if (!this.select) return;
      this.clear();
      const { store } = this, chart = store.data.charts[Number(this.select.value)], group = new Set();
      const order = store.column(store.data.orders[chart.order]), x = counting(order.length), column = (name) => store.column(chart[name]);
      const since = chart.since.map((each) => ({ x: each.at + 0.5, colour: "red", width: 2 }));
      this.say(chart, order);
      this.values(chart, { order, x, column, since, group });
      this.sums(chart, { order, x, column, since, group });
    }

    say(chart, order) {
      const said = chart.since.map((each) => `from ${this.store.names[order[each.at]]} on ${short(Math.abs(each.size))} ${unit(chart.unit)} ${each.size > 0 ? "higher" : "lower"} (red line)`);
      document.getElementById("chart-words").textContent =
        `Above: each unit with the chart's limits (dashed). Below: what adds up above (solid) and below (dashed) the centre; over the decision line the process has moved, or odd units drove the sum there.${said.length ? ` A change was found: ${said.join("; ")}.` : " No change was found."}`;
    }

    values(chart, { order, x, column, since, group }) {
      const y = column("value"), error = column("stderr"), { store } = this;
      const line = (at, dash) => (at === null ? [] : [{ y: at, colour: dash ? "yellow" : "soft", dash }]);
      const painter = new Points(store, {
        x, y, unit: order, low: y.map((v, i) => v - 1.96 * error[i]), high: y.map((v, i) => v + 1.96 * error[i]),
        lines: [...line(chart.centre), ...line(chart.lower, DASH), ...line(chart.upper, DASH), ...since],
        beyond: (i) => (chart.upper !== null && y[i] > chart.upper) || (chart.lower !== null && y[i] < chart.lower),
        words: (k) => `${store.names[k]}: ${short(y[painter.at.get(k)], 4)} ${unit(chart.unit)}`,
      });
      this.add(painter, { title: [...symbol(chart.symbol), element("span", { class: "soft" }, " value; × beyond a limit")], describe: `Control chart of ${chart.symbol}`,
                          unit: chart.unit, xLabel: "", height: 230, group });
    }

    sums(chart, { order, x, column, since, group }) {
      const high = column("cusum_high"), low = column("cusum_low"), { store } = this;
      const top = high.map((v, i) => Math.max(v, low[i]));
      const painter = new Points(store, {
        x, y: top, unit: order, range_y: etcfit.range([top, [0, chart.decision ?? 0]]),
        curves: [{ x, y: high, colour: "plain" }, { x, y: low, colour: "plain", dash: DASH }],
        lines: [...(chart.decision === null ? [] : [{ y: chart.decision, colour: "red", dash: [2, 3] }]), ...since],
        words: (k) => { const i = painter.at.get(k); return `${store.names[k]}: above ${short(high[i])}, below ${short(low[i])}`; },
      });
      painter.dots = () => {};
      this.add(painter, { title: ["CUSUM", element("span", { class: "soft" }, " in standard deviations; dotted: decision")], describe: `Cumulative sums of ${chart.symbol}`, unit: "",
                          xLabel: "unit, in the chart's order", height: 190, group });
    }
  }

  class Effects extends Section {
    constructor(store) { super(store, "effects-panels"); }

    draw() {
      for (const each of this.store.data.effects) {
        const at = this.store.column(each.at), y = this.store.column(each.strength), { store } = this;
        const painter = new Points(store, {
          x: Float64Array.from(at, (k) => k + 1), y, unit: at, range_x: etcfit.range([[1, store.count]], 0.02),
          lines: each.median === null ? [] : [{ y: each.median, colour: "soft" }],
          range_y: etcfit.range([y, [0]]), words: (k) => `${store.names[k]}: ${short(y[painter.at.get(k)])} ${unit(each.unit ?? "")}`,
        });
        const count = ` in ${at.length.toLocaleString("en")} of ${each.of.toLocaleString("en")} units, median ${short(each.median)} ${unit(each.unit ?? "")}`;
        this.add(painter, { title: [words(each.name), element("span", { class: "soft" }, count)], describe: `${words(each.name)}${count}`, yLabel: each.symbol ?? "",
                            unit: each.unit ?? "", xLabel: "unit, in order", height: 170 });
      }
    }
  }

  class Figures extends Section {
    constructor(store) { super(store, "figures-panels"); }

    draw() {
      for (const each of this.store.data.figures) {
        const band = each.low === null || each.high === null ? null : [each.low, each.high];
        const lines = [...(each.mean === null ? [] : [{ x: each.mean, colour: "ink" }]), ...limits(each.limits, "x")];
        const painter = new Bars(this.store, this.store.column(each.value), { band, lines });
        if (each.mean === null) continue; // of no unit: the words above say why
        const said = ` ${etcfit.both(each.mean, each.sd, each.unit)}; ${each.meaning}`;
        this.add(painter, { title: [words(each.name), element("span", { class: "soft" }, said)], describe: `${words(each.name)}:${said}`, xLabel: "", xUnit: each.unit,
                            yLabel: "units", unit: "", height: 170 });
      }
    }
  }

  Object.assign(etcfit, { Population, Pair, Charts, Effects, Figures });
})(globalThis.etcfit ??= {});
