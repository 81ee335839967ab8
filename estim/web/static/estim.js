// Drag and drop, progress, and small comforts.  Every page works without it.
"use strict";

function dropping() {
  const form = document.getElementById("drop");
  if (!form) return;
  const input = form.querySelector("input[type=file]");
  const over = (on) => form.classList.toggle("over", on);
  for (const name of ["dragenter", "dragover"]) {
    document.addEventListener(name, (event) => { event.preventDefault(); over(true); });
  }
  document.addEventListener("dragleave", (event) => { if (!event.relatedTarget) over(false); });
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    over(false);
    if (!event.dataTransfer.files.length) return;
    input.files = event.dataTransfer.files;
    form.requestSubmit();
  });
  input.addEventListener("change", () => { if (input.files.length) form.requestSubmit(); });
}

function models() {
  const formula = document.getElementById("formula");
  const buttons = document.querySelectorAll("button[name=model]");
  const mark = () => {
    for (const button of buttons) button.ariaPressed = String(button.value === formula.value);
  };
  formula?.addEventListener("input", mark);
  for (const button of buttons) {
    button.addEventListener("click", (event) => {
      event.preventDefault();
      formula.value = button.value;
      formula.focus();
      mark();
    });
  }
}

function points() {
  const image = document.getElementById("points");
  const [x, y] = ["x", "y"].map((name) => document.getElementById(name));
  if (!image || !x || !y) return;
  const show = () => {
    image.src = `${image.dataset.at}-${x.selectedIndex}-${y.selectedIndex}.png`;
    image.alt = `${y.value} / ${x.value}`;
    image.nextElementSibling?.remove(); // what was said of a start
  };
  x.addEventListener("change", show);
  y.addEventListener("change", show);
}

function progress() {
  const place = document.getElementById("progress");
  if (!place) return;
  const bar = place.querySelector("progress");
  const words = document.getElementById("doing");
  const look = async () => {
    let wait = 700;
    try {
      const answer = await fetch(place.dataset.state);
      if (!answer.ok) throw new Error(answer.status);
      const state = await answer.json();
      if (state.ended) { location.reload(); return; }
      bar.value = state.percent;
      if (words.textContent !== state.doing) words.textContent = state.doing;
    } catch { wait = 3000; }
    setTimeout(look, wait);
  };
  setTimeout(look, 500);
}

function once() {
  for (const form of document.querySelectorAll("form[method=post]")) {
    form.addEventListener("submit", () => setTimeout(() => {
      for (const button of form.querySelectorAll("button")) button.disabled = true;
    }));
  }
  // back to a page that was left by a click
  window.addEventListener("pageshow", () => {
    for (const button of document.querySelectorAll("button:disabled")) button.disabled = false;
  });
}

for (const part of [dropping, models, points, progress, once]) part();
