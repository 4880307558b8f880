"use strict";
// Sends what was chosen, and asks how a run goes on. Texts stand in the page, as data attributes.
const root = document.body.dataset.root;
const shown = document.getElementById("error");
// Numbers stand as the reader's language writes them.
const mark = new Intl.NumberFormat(navigator.language).formatToParts(1.5).find((part) => part.type === "decimal").value;
const local = (text) => mark === "," ? text.replace(/(\d)\.(\d)/g, "$1,$2") : text;
for (const one of document.querySelectorAll(".number")) one.textContent = local(one.textContent);
for (const one of document.querySelectorAll("[data-kind=number]")) one.value = local(one.value);
async function call(path, options) {
  let answer;
  try { answer = await fetch(root + path, options); } catch { shown.textContent = document.body.dataset.lost; return null; }
  let made = {};
  try { made = await answer.json(); } catch { made = { error: answer.status + " " + answer.statusText }; }
  shown.textContent = answer.ok ? "" : made.error;
  return answer.ok ? made : null;
}
const post = (path, body) => call(path, { method: "POST", body: JSON.stringify(body) });
const go = (made) => { if (made) location.href = root + "/runs/" + made.id; };

async function sent(files) {
  let last = null;
  for (const file of files) last = await call("/api/files/" + encodeURIComponent(file.name), { method: "PUT", body: file }) || last;
  if (last && !shown.textContent) location.reload();
}
const drop = document.querySelector(".drop");
if (drop) {
  drop.querySelector("input").addEventListener("change", (event) => sent(event.target.files));
  for (const name of ["dragover", "dragleave", "drop"]) {
    drop.addEventListener(name, (event) => { event.preventDefault(); drop.classList.toggle("over", name === "dragover"); });
  }
  drop.addEventListener("drop", (event) => sent(event.dataTransfer.files));
}
for (const button of document.querySelectorAll("[data-look]")) {
  button.addEventListener("click", async () => go(await post("/api/runs", { look: button.dataset.look })));
}

// A form: numbers with the decimal mark of the reader's language are understood too.
function valueOf(input) {
  const text = input.value.trim();
  if (text === "") return null;
  if (input.dataset.kind === "number") {
    const value = Number(text.replace(",", "."));
    if (!Number.isFinite(value)) throw new Error(input.dataset.label + ": " + text);
    return value;
  }
  if (input.dataset.kind !== "json") return text;
  try { return JSON.parse(text); } catch { return text; }
}
const form = document.querySelector("form[data-pipeline]");
function inputs() {
  const found = {};
  for (const input of form.querySelectorAll("[data-kind]")) found[input.name] = valueOf(input);
  return found;
}
async function submit(path, more) {
  try { return await post(path, { pipeline: form.dataset.pipeline, inputs: inputs(), ...more }); }
  catch (error) { shown.textContent = error.message; return null; }
}
if (form) {
  form.addEventListener("submit", async (event) => { event.preventDefault(); go(await submit("/api/runs", {})); });
  document.getElementById("save").addEventListener("click", async () => {
    if (await submit("/api/presets", { name: document.getElementById("preset").value })) location.href = root + "/";
  });
}

// The ticked files of one scan: what they are is drafted, and asked.
const draftButton = document.getElementById("draft");
if (draftButton) {
  draftButton.addEventListener("click", async () => {
    const files = [...document.querySelectorAll("td input:checked")].map((box) => box.value);
    const cell = document.getElementById("cell");
    go(await post("/api/runs", { draft: files, preset: cell && cell.value ? cell.value : null }));
  });
}

// A draft: each answer goes into the mapping, and the picture is drawn anew.
const draft = document.querySelector("[data-draft]");
if (draft) {
  const [text, picture, drawing] = ["mapping", "picture", "drawing"].map((name) => document.getElementById(name));
  const number = Number(draft.dataset.draft), doubts = [...draft.querySelectorAll("[data-doubt]")];
  const open = () => doubts.filter((one) => !one.querySelector("[data-right]").checked).map((one) => one.dataset.doubt);
  const mapping = () => ({ ...JSON.parse(text.value), uncertain: open() });
  const asked = (path, body) => { try { return post(path, body()); } catch (error) { shown.textContent = error.message; return null; } };
  let last = null;
  const draw = async () => {
    if (last) await post("/api/runs/" + last + "/cancel", {});
    const made = await asked("/api/runs", () => ({ draft: number, mapping: mapping() }));
    if (!made) return;
    last = made.id; drawing.textContent = drawing.dataset.words;
    follow(made.id, null, (run) => {
      if (run.id !== last) return;
      const done = run.state === "done";
      drawing.textContent = ""; shown.textContent = done ? "" : run.reason;
      picture.hidden = !done;
      if (done) picture.src = root + "/results/" + number + "/look.html?" + run.id;
    });
  };
  for (const input of draft.querySelectorAll("[data-place]")) {
    input.addEventListener("change", () => {
      const tree = JSON.parse(text.value), [part, name] = input.dataset.place.split(".");
      let value = input.value;
      if (input.tagName === "INPUT") try { value = JSON.parse(value); } catch { /* a text */ }
      if (name) tree[part][name] = value; else tree[part] = value;
      text.value = JSON.stringify(tree, null, 2); draw();
    });
  }
  text.addEventListener("change", draw);
  draft.querySelector("form").addEventListener("submit", async (event) => {
    event.preventDefault();
    if (open().length) { shown.textContent = draft.dataset.open; return; }
    go(await asked("/api/runs", () => ({ draft: number, mapping: mapping(), made: document.getElementById("made").value })));
  });
  document.getElementById("save-cell").addEventListener("click", async () => {
    const name = document.getElementById("preset").value;
    if (await asked("/api/presets", () => ({ name, pipeline: "import", inputs: mapping() }))) location.href = root + "/";
  });
  draw();
}

// A run at work: its step, then the page anew.
const atWork = document.querySelector("[data-run]");
async function follow(number, step, done, known) {
  const run = await call("/api/runs/" + number);
  const told = local(run && run.step || "");
  if (run && step && step.textContent !== told) step.textContent = told;
  if (run && known) known(run);
  if (run && !["queued", "running"].includes(run.state)) done(run); else setTimeout(() => follow(number, step, done, known), 200);
}
const tell = (element, word, states) => { element.textContent = states[word] || word; element.className = "verdict " + word; };
if (atWork) {
  const states = JSON.parse(atWork.dataset.states), word = atWork.querySelector(".verdict");
  const step = atWork.querySelector(".step"), drawing = atWork.querySelector("img");
  new MutationObserver(() => { // the sections of a recording that grows
    if (step.textContent.includes(" so far: ")) drawing.src = drawing.dataset.at + "?" + encodeURIComponent(step.textContent);
  }).observe(step, { childList: true });
  drawing.addEventListener("load", () => { drawing.hidden = false; });
  follow(atWork.dataset.run, step, () => location.reload(), (run) => tell(word, run.verdict || run.state, states));
  atWork.querySelector("button").addEventListener("click", () => post("/api/runs/" + atWork.dataset.run + "/cancel", {}));
}

// The operator's page: a new recording, or the button, begins a run of the preset.
const operator = document.querySelector("[data-preset]");
if (operator) {
  const preset = JSON.parse(document.getElementById("preset-data").textContent);
  const [verdict, todo, step] = ["verdict", "todo", "step"].map((name) => document.getElementById(name));
  let last = null, busy = false;
  const measure = async (file) => {
    busy = true; verdict.textContent = "…"; verdict.className = "verdict"; todo.textContent = file;
    const made = await post("/api/runs", { pipeline: preset.pipeline, inputs: { ...preset.inputs, [preset.file]: file } });
    if (!made) { busy = false; return; }
    const known = (run, word) => {
      tell(verdict, word, preset.states);
      todo.textContent = [run.part, run.todo || preset.todo[word], word === "failed" ? run.reason : ""].filter(Boolean).join(" · ");
    };
    follow(made.id, step, async (run) => {
      known(run, run.state === "done" ? run.verdict : "failed"); step.textContent = "";
      const now = await call("/api/next"); // it has grown meanwhile
      if (now && now.file === file) last = file + now.written;
      busy = false;
    }, (run) => { if (run.verdict) known(run, run.verdict); });
  };
  const watch = async () => {
    const found = await call("/api/next");
    const key = found && found.file ? found.file + found.written : null;
    if (key && last !== null && key !== last && !busy && (found.grows || Date.now() / 1000 - found.written > 1)) { last = key; measure(found.file); }
    if (found && last === null) last = key || "";
    setTimeout(watch, 700);
  };
  document.getElementById("next").addEventListener("click", async () => {
    const found = await call("/api/next");
    if (found && found.file && !busy) { last = found.file + found.written; measure(found.file); }
  });
  watch();
}
