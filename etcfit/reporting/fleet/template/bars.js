"use strict";
/* A histogram of the units shown; the one chosen is a line at its value. */
(function (etcfit) {
  class Bars {
    /* value: one of each unit; given: {band: [low, high] or null, lines: [{x, colour, dash}]}. */
    constructor(store, value, given) {
      Object.assign(this, given, { store, value });
      this.x = etcfit.range([value, (this.lines ?? []).map((each) => each.x)], 0.03);
      this.bins = Math.max(8, Math.min(60, Math.ceil(1.5 * Math.sqrt(value.length))));
      this.y = [0, 1.06 * Math.max(1, ...this.counts(() => true))];
    }

    counts(keep) {
      const [low, high] = this.x, counts = new Array(this.bins).fill(0);
      this.value.forEach((value, k) => {
        if (Number.isFinite(value) && keep(k)) counts[Math.min(this.bins - 1, Math.floor((this.bins * (value - low)) / (high - low)))]++;
      });
      return counts;
    }

    spot(k) { return Number.isFinite(this.value[k]) && this.store.shown[k] ? [this.value[k], null] : null; }

    paint(ctx, to, box) {
      const [low, high] = this.x, width = (high - low) / this.bins, ground = to.y(0);
      if (this.band) {
        ctx.fillStyle = etcfit.colour("band");
        ctx.fillRect(to.x(this.band[0]), box.top, to.x(this.band[1]) - to.x(this.band[0]), box.height);
      }
      ctx.fillStyle = etcfit.colour("plain");
      this.counts((k) => this.store.shown[k]).forEach((count, i) => {
        const left = to.x(low + i * width), right = to.x(low + (i + 1) * width);
        if (count) ctx.fillRect(left, to.y(count), Math.max(1, right - left - to.ratio), ground - to.y(count));
      });
      for (const { x, colour, dash } of this.lines ?? []) {
        ctx.strokeStyle = etcfit.colour(colour);
        ctx.lineWidth = 1.5 * to.ratio;
        ctx.setLineDash((dash ?? []).map((each) => each * to.ratio));
        ctx.beginPath();
        ctx.moveTo(to.x(x), box.top);
        ctx.lineTo(to.x(x), box.top + box.height);
        ctx.stroke();
        ctx.setLineDash([]);
      }
    }
  }

  etcfit.Bars = Bars;
})(globalThis.etcfit ??= {});
