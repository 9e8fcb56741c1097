"use strict";
/* One chart: uPlot gives axes, grid, cursor and zoom; a painter draws what is in it. Nothing is drawn before it is in sight. */
(function (etcfit) {
  const { element } = etcfit;
  const FONT = "12px system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif";
  const STEP = 0.25, IN = 0.6, NEAR = 14; // of what is seen: a pan, and what a zoom leaves; reach of the pointer, px
  const waiting = new Map();
  const watch = new IntersectionObserver((seen) => {
    for (const each of seen) if (waiting.has(each.target)) waiting.get(each.target).sight(each.isIntersecting);
  }, { rootMargin: "250px" });

  const tip = element("div", { class: "tip", hidden: true });
  document.body.append(tip);

  /* Ticks in powers of a thousand, so that they stay short: the power stands in the label. */
  const power = etcfit.power = function (low, high = low) {
    const size = Math.max(Math.abs(low), Math.abs(high));
    if (size === 0 || (size >= 1e-2 && size < 1e5)) return 0;
    return 3 * Math.floor(Math.log10(size) / 3 + 1e-9);
  };

  const raised = etcfit.raised = (p) => `10${[...String(p)].map((c) => ({ "-": "⁻" })[c] ?? "⁰¹²³⁴⁵⁶⁷⁸⁹"[c]).join("")}`;

  /* A power of ten and a unit as they stand behind a number. */
  const behind = etcfit.behind = (p, unit) => [p ? raised(p) : "", etcfit.unit(unit ?? "")].filter(Boolean).join(" ");

  /* Mean and spread with the power of ten that both have, once. */
  etcfit.both = function (mean, sd, unit) {
    const p = power(mean), of = 10 ** p, digits = Math.max(3, Math.min(7, 2 + Math.ceil(Math.log10(Math.abs(mean / sd) || 1))));
    const pair = `${etcfit.short(mean / of, digits)} ± ${etcfit.short(sd / of, 2)}`;
    return `${p ? `(${pair})` : pair} ${behind(p, unit)}`.trim();
  };

  class Panel {
    /* host: an element; store; painter: {x, y: whole ranges, paint(panel, to), near(to, x, y), spot(k), words(k)};
       how: {title: nodes, describe, xLabel, yLabel, unit, height, group: charts that share the x axis}. */
    constructor(host, store, painter, how) {
      Object.assign(this, { store, painter, how, stale: true, seen: false });
      this.box = element("div", { class: "chart", role: "img", tabindex: "0", "aria-label": how.describe });
      this.root = element("div", { class: "panel" }, element("h3", {}, ...how.title), this.box);
      this.box.style.minHeight = `${how.height ?? 180}px`;
      this.spots = ["hovered", "chosen"].map((name) => element("div", { class: `spot ${name === "hovered" ? "hover" : ""}`, hidden: true }));
      host.append(this.root);
      how.group?.add(this);
      this.whole();
      this.box.addEventListener("keydown", (event) => this.key_pressed(event));
      waiting.set(this.box, this);
      watch.observe(this.box);
      Panel.every.add(this);
    }

    sight(seen) {
      this.seen = seen;
      if (seen) this.refresh();
    }

    /* To be drawn anew, at once where it is in sight. */
    again() {
      this.stale = true;
      if (this.seen) this.refresh();
    }

    refresh() {
      if (!this.stale) return this.mark();
      this.stale = false;
      if (this.plot) this.plot.redraw(true, true);
      else this.build();
      this.mark();
    }

    /* Made from nothing: other colours, another size. */
    remake() {
      this.plot?.destroy();
      this.plot = null;
      this.again();
    }

    gone() {
      this.plot?.destroy();
      waiting.delete(this.box);
      watch.unobserve(this.box);
      Panel.every.delete(this);
      this.how.group?.delete(this);
      this.root.remove();
    }

    build() {
      const { x, y } = this.view, ink = etcfit.colour("soft"), grid = { stroke: etcfit.colour("grid"), width: 1 };
      const axis = { stroke: ink, grid, ticks: grid, font: FONT, labelFont: FONT, labelGap: 0, labelSize: 18 };
      const scaled = (range) => {
        const p = power(...range());
        return (_, ticks) => ticks.map((t) => String(Number((t / 10 ** p).toPrecision(6))).replace("-", "−"));
      };
      const label = (words, unit, range) => {
        const of = behind(power(...range), unit);
        return of ? `${words} [${of}]`.trim() : words;
      };
      this.width = Math.max(220, this.box.clientWidth);
      this.plot = new uPlot({
        width: this.width, height: this.how.height ?? 180, legend: { show: false }, padding: [6, 22, 0, 0],
        scales: { x: { time: false }, y: { range: () => this.view.y } },
        axes: [{ ...axis, label: label(this.how.xLabel, this.how.xUnit, this.painter.x), values: scaled(() => this.painter.x), size: 28 },
               { ...axis, label: label(this.how.yLabel ?? "", this.how.unit, this.painter.y), values: scaled(() => this.painter.y), size: 50 }],
        series: [{}, { paths: () => null, points: { show: false } }],
        cursor: {
          drag: { x: true, y: true, setScale: false, uni: 20 }, points: { show: false },
          bind: { dblclick: () => () => { this.whole(); this.shared(); } },
        },
        hooks: {
          draw: [(plot) => this.paint(plot)],
          setSelect: [(plot) => this.selected(plot)],
          setCursor: [(plot) => this.pointed(plot)],
        },
      }, [x, y], this.box);
      const { over } = this.plot;
      over.append(...this.spots);
      over.addEventListener("mouseleave", () => { this.store.hover(-1); tip.hidden = true; });
      over.addEventListener("click", (event) => this.clicked(event));
    }

    /* From values to pixels: of the canvas, or on the screen. */
    map(screen) {
      const { plot, view } = this, of = (key, a, b) => {
        const from = plot.valToPos(a, key, !screen), size = plot.valToPos(b, key, !screen) - from;
        return (value) => from + (size * (value - a)) / (b - a);
      };
      return { x: of("x", ...view.x), y: of("y", ...view.y), ratio: screen ? 1 : devicePixelRatio, view };
    }

    paint(plot) {
      const { ctx, bbox } = plot;
      ctx.save();
      ctx.beginPath();
      ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
      ctx.clip();
      this.painter.paint(ctx, this.map(false), bbox);
      ctx.restore();
    }

    /* The rings about the unit under the pointer and the one chosen, cheap to move. */
    mark() {
      if (!this.plot) return;
      const to = this.map(true), { width, height } = this.plot.over.getBoundingClientRect();
      for (const [i, k] of [this.store.hovered, this.store.chosen].entries()) {
        const spot = this.spots[i], at = k < 0 ? null : this.painter.spot(k);
        const px = at && [to.x(at[0]), at[1] === null ? 0 : to.y(at[1])];
        spot.hidden = !px || !(px[0] >= -1 && px[0] <= width + 1 && px[1] >= -1 && px[1] <= height + 1);
        if (spot.hidden) continue;
        spot.classList.toggle("line", at[1] === null);
        spot.style.left = `${px[0]}px`;
        spot.style.top = `${px[1]}px`;
      }
    }

    pointed(plot) {
      const { left, top } = plot.cursor;
      if (!(left >= 0) || !this.painter.near) return;
      const k = this.painter.near(this.map(true), left, top, NEAR);
      this.store.hover(k);
      tip.hidden = k < 0;
      if (k < 0) return;
      const box = plot.over.getBoundingClientRect();
      tip.textContent = this.painter.words(k);
      const width = tip.offsetWidth, x = box.left + left;
      tip.style.left = `${x + width + 24 > innerWidth ? Math.max(2, x - width - 14) : x + 14}px`;
      tip.style.top = `${Math.min(innerHeight - 30, box.top + top + 14)}px`;
    }

    clicked(event) {
      if (this.dragged || !this.painter.near) { this.dragged = false; return; }
      const box = this.plot.over.getBoundingClientRect();
      const k = this.painter.near(this.map(true), event.clientX - box.left, event.clientY - box.top, NEAR);
      if (k >= 0) this.store.choose(k);
    }

    selected(plot) {
      const { left, top, width, height } = plot.select;
      if (width < 4 && height < 4) return;
      this.dragged = true;
      setTimeout(() => { this.dragged = false; });
      const whole = { x: width < plot.over.clientWidth - 1 && width >= 4, y: height < plot.over.clientHeight - 1 && height >= 4 };
      if (whole.x) this.view.x = [plot.posToVal(left, "x"), plot.posToVal(left + width, "x")];
      if (whole.y) this.view.y = [plot.posToVal(top + height, "y"), plot.posToVal(top, "y")];
      plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
      this.shared();
    }

    whole() { this.view = { x: [...this.painter.x], y: [...this.painter.y] }; }

    /* What this one shows of the x axis is what its group shows. */
    shared() {
      for (const each of this.how.group ?? [this]) each.show(this.view.x);
    }

    show([min, max]) {
      this.view.x = [min, max];
      if (this.plot) this.plot.setScale("x", { min, max });
      this.again();
    }

    key_pressed(event) {
      const how = { ArrowLeft: "left", ArrowRight: "right", "+": "in", "=": "in", "-": "out", 0: "whole", Home: "whole" }[event.key];
      if (!how || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      this.zoom(how);
    }

    zoom(how) {
      const [first, last] = this.painter.x, [min, max] = this.view.x, span = max - min, middle = 0.5 * (min + max);
      if (how === "whole") this.whole();
      else {
        let [low, high] = { left: [min - STEP * span, max - STEP * span], right: [min + STEP * span, max + STEP * span],
                            in: [middle - 0.5 * IN * span, middle + 0.5 * IN * span],
                            out: [middle - 0.5 * span / IN, middle + 0.5 * span / IN] }[how];
        if (low < first) [low, high] = [first, Math.min(last, first + high - low)];
        if (high > last) [low, high] = [Math.max(first, last - (high - low)), last];
        this.view.x = [low, high];
      }
      this.shared();
    }

    fit() { if (this.plot && Math.max(220, this.box.clientWidth) !== this.width) this.remake(); }
  }

  Panel.every = new Set();

  etcfit.Panel = Panel;
})(globalThis.etcfit ??= {});
