"use strict";
/* A light and a dark page: first as the system has it, then as the button says. */
(function (etcfit) {
  const root = document.documentElement;

  /* button: switches; repaint(): called after every change, for what is drawn rather than styled. */
  etcfit.theme = function (button, repaint) {
    const dark = matchMedia("(prefers-color-scheme: dark)");
    function paint(wanted) {
      root.dataset.theme = wanted;
      button.textContent = wanted === "dark" ? "Light" : "Dark";
      button.setAttribute("aria-label", `Switch to the ${wanted === "dark" ? "light" : "dark"} page`);
      button.setAttribute("aria-pressed", String(wanted === "dark"));
      repaint();
    }
    paint(dark.matches ? "dark" : "light");
    dark.addEventListener("change", () => paint(dark.matches ? "dark" : "light"));
    button.addEventListener("click", () => paint(root.dataset.theme === "dark" ? "light" : "dark"));
  };
})(globalThis.etcfit ??= {});
