"use strict";
/* Numbers, symbols and small elements as the page writes them. */
(function (etcfit) {
  const RAISED = { "-": "⁻", 0: "⁰", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵", 6: "⁶", 7: "⁷", 8: "⁸", 9: "⁹" };

  /* A few significant digits; a power of ten where the number is far from one. */
  etcfit.short = function (value, digits = 3) {
    if (value === null || value === undefined || Number.isNaN(value)) return "–";
    if (!Number.isFinite(value)) return "∞";
    const size = Math.abs(value);
    if (size !== 0 && (size < 1e-3 || size >= 1e5)) {
      const [mantissa, power] = value.toExponential(digits - 1).split("e");
      return `${mantissa} × 10${[...String(Number(power))].map((c) => RAISED[c]).join("")}`.replace("-", "−");
    }
    return String(Number(value.toPrecision(digits))).replace("-", "−");
  };

  /* ohm, N*m/rad and the like as they are printed. */
  etcfit.unit = (text) =>
    text === "1" ? "" : text.replace(/\bohm\b/g, "Ω").replace(/\*\*/g, "").replace(/([a-zA-Z)])(-?\d)/g,
      (_, letter, power) => letter + [...power].map((c) => RAISED[c]).join("")).replace(/\*/g, " ");

  /* An element: tag, attributes, and children, text or elements. Text stays text. */
  etcfit.element = function (tag, attributes = {}, ...children) {
    const made = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name in made && typeof value !== "string") made[name] = value;
      else made.setAttribute(name, value);
    }
    made.append(...children);
    return made;
  };

  /* R_a as R with a subscript. */
  etcfit.symbol = function (name) {
    const [head, ...below] = name.split("_"), greek = { theta: "θ", tau: "τ", mu: "μ", delta: "δ", omega: "ω" };
    const text = etcfit.element("i", {}, greek[head] ?? head);
    return below.length ? [text, etcfit.element("sub", {}, below.join("_"))] : [text];
  };

  /* A sentence with its `commands` set as code. */
  etcfit.with_code = (text) => text.split("`").map((part, k) => (k % 2 ? etcfit.element("code", {}, part) : part));

  etcfit.words = (name) => name.replaceAll("_", " ");
  etcfit.colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
})(globalThis.etcfit ??= {});
