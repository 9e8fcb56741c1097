"use strict";
/* Units as points, with intervals, bands and lines: what most charts are painted by. */
(function (etcfit) {
  const MANY = 1500; // points from which on they are drawn smaller

  /* Ends of what is finite, a little beyond them. */
  etcfit.range = function (lists, share = 0.06) {
    let low = Infinity, high = -Infinity;
    for (const list of lists) for (const value of list) {
      if (value !== null && Number.isFinite(value)) { low = Math.min(low, value); high = Math.max(high, value); }
    }
    if (low > high) return [0, 1];
    const pad = share * (high - low) || 0.05 * Math.abs(high) || 1;
    return [low - pad, high + pad];
  };

  class Points {
    /* given: {x, y: a list each, a number a point; unit: of each point, absent where point k is unit k; low, high: intervals;
       bands: [[low, high]]; lines: [{y or x, dash, colour}]; curves: [{x, y, colour, dash}]; range_x, range_y: what is shown at first;
       beyond(i): whether a point is out of its limits; words(k)}. */
    constructor(store, given) {
      Object.assign(this, given, { store });
      this.at = new Map();
      if (this.unit) this.unit.forEach((k, i) => this.at.set(k, i));
      this.x = this.range_x ?? etcfit.range([given.x], 0.02);
      this.px = given.x;
      this.py = given.y;
      this.y = this.range_y ?? etcfit.range([this.py, ...(this.bands ?? []), (this.lines ?? []).map((each) => each.y ?? null)]);
    }

    of(i) { return this.unit ? this.unit[i] : i; }

    spot(k) {
      const i = this.unit ? this.at.get(k) : k;
      if (i === undefined || !Number.isFinite(this.py[i]) || !this.store.shown[k]) return null;
      return [this.px[i], this.py[i]];
    }

    near(to, x, y, reach) {
      let best = -1, least = reach * reach;
      for (let i = 0; i < this.px.length; i++) {
        if (!this.store.shown[this.of(i)]) continue;
        const dx = to.x(this.px[i]) - x, dy = to.y(this.py[i]) - y, d = dx * dx + dy * dy;
        if (d < least) { least = d; best = i; }
      }
      return best < 0 ? -1 : this.of(best);
    }

    paint(ctx, to, box) {
      const { colour } = etcfit, right = box.left + box.width;
      ctx.fillStyle = colour("band");
      for (const [low, high] of this.bands ?? []) ctx.fillRect(box.left, to.y(high), box.width, to.y(low) - to.y(high));
      this.whiskers(ctx, to);
      this.dots(ctx, to);
      for (const each of this.lines ?? []) {
        if (each.y === null) continue;
        const ends = each.y === undefined ? [[to.x(each.x), box.top], [to.x(each.x), box.top + box.height]]
          : [[box.left, to.y(each.y)], [right, to.y(each.y)]];
        this.stroke(ctx, to, ends, each);
      }
      for (const each of this.curves ?? []) this.stroke(ctx, to, Array.from(each.x, (x, i) => [to.x(x), to.y(each.y[i])]), each);
    }

    stroke(ctx, to, ends, { colour, dash, width = 1.5 }) {
      ctx.strokeStyle = etcfit.colour(colour);
      ctx.lineWidth = width * to.ratio;
      ctx.setLineDash((dash ?? []).map((each) => each * to.ratio));
      ctx.beginPath();
      ends.forEach(([x, y], i) => (i ? ctx.lineTo(x, y) : ctx.moveTo(x, y)));
      ctx.stroke();
      ctx.setLineDash([]);
    }

    seen(i, view) { return this.store.shown[this.of(i)] && this.px[i] >= view.x[0] && this.px[i] <= view.x[1] && Number.isFinite(this.py[i]); }

    whiskers(ctx, to) {
      if (!this.low) return;
      ctx.strokeStyle = etcfit.colour("whisker");
      ctx.lineWidth = Math.max(1, to.ratio);
      ctx.beginPath();
      for (let i = 0; i < this.px.length; i++) {
        if (!this.seen(i, to.view) || !(this.high[i] > this.low[i])) continue;
        const x = to.x(this.px[i]);
        ctx.moveTo(x, to.y(this.low[i]));
        ctx.lineTo(x, to.y(this.high[i]));
      }
      ctx.stroke();
    }

    /* Squares, the quickest there is; odd ones are diamonds on top, those out of their limits crosses. */
    dots(ctx, to) {
      const size = (this.px.length > MANY ? 2 : 4) * to.ratio, special = [];
      ctx.fillStyle = etcfit.colour("plain");
      ctx.globalAlpha = this.px.length > MANY ? 0.45 : 1; // many are a cloud, in which what is dense is dark
      for (let i = 0; i < this.px.length; i++) {
        if (!this.seen(i, to.view)) continue;
        if (this.store.odd.has(this.of(i)) || this.beyond?.(i)) special.push(i);
        else ctx.fillRect(to.x(this.px[i]) - size / 2, to.y(this.py[i]) - size / 2, size, size);
      }
      ctx.globalAlpha = 1;
      ctx.fillStyle = ctx.strokeStyle = etcfit.colour("odd");
      ctx.lineWidth = 1.6 * to.ratio;
      for (const i of special) this.special(ctx, to.x(this.px[i]), to.y(this.py[i]), to.ratio, this.store.odd.has(this.of(i)));
    }

    special(ctx, x, y, ratio, odd) {
      const r = 4.5 * ratio;
      ctx.beginPath();
      if (odd) {
        ctx.moveTo(x - r, y); ctx.lineTo(x, y - r); ctx.lineTo(x + r, y); ctx.lineTo(x, y + r);
        ctx.fill();
      } else {
        ctx.moveTo(x - 0.7 * r, y - 0.7 * r); ctx.lineTo(x + 0.7 * r, y + 0.7 * r);
        ctx.moveTo(x - 0.7 * r, y + 0.7 * r); ctx.lineTo(x + 0.7 * r, y - 0.7 * r);
        ctx.stroke();
      }
    }
  }

  etcfit.Points = Points;
})(globalThis.etcfit ??= {});
