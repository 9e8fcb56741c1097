"use strict";
/* Charts one above the other that share a time axis: zoom one and all follow. */
(function (etcfit) {
  const { element } = etcfit;
  const HEIGHT = 190, LOW = 120, NARROW = 150;
  const STEP = 0.25, IN = 0.6; // of what is seen: a pan, and what a zoom leaves

  class Stack {
    /* host: an element; told(t, charts): where the cursor is, null where it is nowhere. */
    constructor(host, told = () => {}) {
      this.host = host;
      this.told = told;
      this.charts = [];
      this.key = `stack-${Stack.count = (Stack.count ?? 0) + 1}`;
      new ResizeObserver(() => this.fit()).observe(host);
    }

    clear() {
      for (const each of this.charts) each.plot.destroy();
      this.charts = [];
      this.host.replaceChildren();
      this.zoomed = null;
    }

    /* One chart: {title, label, describe, t, low, series: [{name, label, values, colour, dash, dots, width}]}. */
    add(chart) {
      const box = element("div", { class: "chart", role: "img", tabindex: "0", "aria-label": chart.describe });
      this.host.append(element("h3", {}, chart.title), box);
      const entry = { ...chart, box, whole: [chart.t[0], chart.t[chart.t.length - 1]] };
      entry.plot = new uPlot(this.options(entry), [chart.t, ...chart.series.map((each) => each.values)], box);
      box.addEventListener("keydown", (event) => this.key_pressed(event));
      this.charts.push(entry);
      return entry;
    }

    options(entry) {
      const ink = etcfit.colour("soft"), grid = { stroke: etcfit.colour("grid"), width: 1 };
      const axis = { stroke: ink, grid, ticks: grid, font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif" };
      return {
        width: this.width(), height: entry.low ? LOW : this.host.clientWidth < 520 ? NARROW : HEIGHT, legend: { show: false },
        cursor: {
          drag: { x: true, y: false },
          sync: { key: this.key, setSeries: false, filters: { pub: (type) => type === "mousemove" || type === "mouseleave" } },
          points: { size: 6 },
        },
        scales: { x: { time: false } },
        axes: [{ ...axis, values: (_, ticks) => ticks.map((t) => `${Number(t.toPrecision(6))} s`), size: 30 },
               { ...axis, label: entry.label, size: 54, labelSize: 20 }],
        series: [{}, ...entry.series.map((each) => ({
          label: each.label, stroke: etcfit.colour(each.colour), width: each.width ?? 1.5, dash: each.dash, show: each.show ?? true,
          spanGaps: false, paths: each.dots ? () => null : undefined,
          points: each.dots ? { show: true, size: 3, width: 0, fill: etcfit.colour(each.colour) } : { show: false },
        }))],
        hooks: {
          setScale: [(plot, key) => { if (key === "x") this.follow(plot); }],
          setCursor: [(plot) => this.told(plot.cursor.idx === null ? null : entry, plot.cursor.idx)],
        },
      };
    }

    width() { return Math.max(240, this.host.clientWidth); }

    fit() {
      for (const { plot } of this.charts) if (plot.width !== this.width()) plot.setSize({ width: this.width(), height: plot.height });
    }

    /* All charts show what this one shows. */
    follow(plot) {
      if (this.following) return;
      const { min, max } = plot.scales.x;
      this.following = true;
      this.zoomed = [min, max];
      for (const each of this.charts) if (each.plot !== plot) each.plot.setScale("x", { min, max });
      queueMicrotask(() => { this.following = false; });
    }

    show(min, max) { if (this.charts.length) this.charts[0].plot.setScale("x", { min, max }); }

    zoom(how) {
      if (!this.charts.length) return;
      const [first, last] = this.charts[0].whole, { min, max } = this.charts[0].plot.scales.x, span = max - min;
      const middle = 0.5 * (min + max);
      const move = { left: [min - STEP * span, max - STEP * span], right: [min + STEP * span, max + STEP * span],
                     in: [middle - 0.5 * IN * span, middle + 0.5 * IN * span],
                     out: [middle - 0.5 * span / IN, middle + 0.5 * span / IN], whole: [first, last] }[how];
      let [low, high] = move;
      if (low < first) [low, high] = [first, Math.min(last, first + high - low)];
      if (high > last) [low, high] = [Math.max(first, last - (high - low)), last];
      this.show(low, high);
    }

    key_pressed(event) {
      const how = { ArrowLeft: "left", ArrowRight: "right", "+": "in", "=": "in", "-": "out", 0: "whole", Home: "whole" }[event.key];
      if (!how) return;
      event.preventDefault();
      this.zoom(how);
    }

    /* Other values of one curve of a chart, the zoom as it is. */
    set(entry, name, values) {
      const k = entry.series.findIndex((each) => each.name === name);
      entry.series[k].values = values;
      const [min, max] = this.zoomed ?? entry.whole;
      entry.plot.batch(() => {
        entry.plot.setData([entry.t, ...entry.series.map((each) => each.values)], false);
        entry.plot.setScale("x", { min, max });
      });
    }

    toggle(name, show) {
      for (const { plot, series } of this.charts) {
        const k = series.findIndex((each) => each.name === name);
        if (k >= 0) plot.setSeries(k + 1, { show });
      }
    }
  }

  etcfit.Stack = Stack;
})(globalThis.etcfit ??= {});
