// The workbench in the browser: it shows the pieces that the server makes, and says what was pressed. No figures are made here.
"use strict";
(() => {
  const byId = (id) => document.getElementById(id);
  const REACH_AGAIN_MS = 1000, WATCH_MS = 500;
  const BESIDE_WORK = ["card", "beside", "swaps", "ring", "hold", "close"]; // buttons that ask for no work of the session
  const WHILE_BUSY = ["cancel", "pause"];
  const SILENT = "The workbench does not answer. Where it was ended, start 'armtrue open' on the same files again: the session is kept.";
  const SHOW_PROGRESS_AFTER_MS = 400, KEEP_DRAFT_MS = 300;
  // The model whose pieces stand on the page, how much of its diagnosis, and how many actions had ended.
  let model = null, known = null, ended = 0;
  const OF_THE_DIAGNOSIS = ["spectra", "unexplained"]; // the other parts below show the fit alone
  let busy = false, diagnosing = false, wanted = null, drawing = false, again = false, waitingForProgress = 0, waitingForDraft = 0;
  let next = null; // an "open" that waits for the one that runs
  let picked = [], leftOut = []; // the rows that the arm's picture reads out, and those that are left out
  const drawn = new Map(); // the pieces as they stand on the page
  let held = null; // where the keyboard was when a button was pressed: a button that is disabled loses it

  async function ask(address, request) {
    let answer;
    try { answer = await fetch(address, request); } catch { throw new Error(SILENT); }
    if (answer.ok) return answer;
    let sentence = `The workbench answered ${answer.status}.`;
    try { sentence = (await answer.json()).error || sentence; } catch { /* no sentence came along */ }
    throw new Error(sentence);
  }

  function fail(sentence) {
    const place = byId("failure");
    place.textContent = sentence;
    place.hidden = !sentence;
  }

  async function act(words) {
    if (busy && !WHILE_BUSY.includes(words.do)) {
      if (words.do === "open" && words.form && !("mend" in words)) next = words;
      return;
    }
    held = focused();
    fail("");
    busy ||= words.do === "open"; // what is chosen until the server says so waits as well
    try {
      await ask("do", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(words) });
    } catch (error) {
      wanted = null;
      busy &&= words.do !== "open";
      fail(error.message);
    }
  }

  function press(button) {
    const words = { do: button.dataset.act };
    for (const key of ["candidate", "effect", "node", "session"]) if (key in button.dataset) words[key] = Number(button.dataset[key]);
    if ("rows" in button.dataset) words.rows = JSON.parse(button.dataset.rows);
    if (words.do === "card") return void showCard(`card?candidate=${words.candidate}`);
    if (words.do === "beside") return void showCard(`beside?node=${words.node}`);
    if (words.do === "swaps") return void showCard(`swaps?effect=${words.effect}`);
    if (words.do === "ring") return void ring(words.rows);
    if (words.do === "swap" || words.do === "add") byId("card-dialog").close();
    if (words.do === "name") words.name = byId("model-name").value;
    if (words.do === "hold") return void hold(button);
    if (words.do === "close") return void byId("card-dialog").close();
    if (words.do === "mark") Object.assign(words, { do: "leave_out", rows: [...leftOut, ...picked] });
    if ("entry" in button.dataset) words.entry = JSON.parse(button.dataset.entry);
    if (words.do === "leave_out_where") {
      const number = (id) => (byId(id).value === "" ? null : Number(byId(id).value));
      Object.assign(words, { variable: byId("leave-variable").value, low: number("leave-low"), high: number("leave-high") });
    }
    if (words.do === "leave_out_brushed") Object.assign(words, { do: "leave_out_where", ...globalThis.armtrueLooking.range() });
    if (words.do === "plan") {
      wanted = "plan";
      words.poses = Number(byId("poses").value);
      if ("rivals" in button.dataset) words.rivals = JSON.parse(button.dataset.rivals);
      byId("card-dialog").close();
    }
    if (words.do === "open" && "mend" in button.dataset) Object.assign(words, { mend: Number(button.dataset.mend), form: filledIn() });
    if (button.dataset.source === "text") words.text = byId("dataset").value;
    if (button.dataset.source === "form") words.form = filledIn();
    if (words.do === "export" || words.do === "report") {
      wanted = words.do;
      Object.assign(words, { do: "make", name: button.dataset.name || words.do });
    }
    act(words);
  }

  /** What the form of the guesses says. */
  function filledIn() {
    const fields = {}, columns = {};
    document.querySelectorAll("#opening [data-form]").forEach((field) => { fields[field.dataset.form] = field.value; });
    document.querySelectorAll("#opening [data-column]").forEach((field) => {
      columns[field.dataset.column] = { ...columns[field.dataset.column], [field.dataset.what]: field.value };
    });
    return { fields, columns };
  }

  /** Has the server keep the form of the guesses while it is changed: a killed server comes back with it. */
  function keepDraft() {
    clearTimeout(waitingForDraft);
    waitingForDraft = setTimeout(async () => {
      if (!byId("dataset")) return;
      try {
        await ask("draft", { method: "POST", body: JSON.stringify({ form: filledIn(), text: byId("dataset").value }) });
      } catch (error) {
        fail(error.message);
      }
    }, KEEP_DRAFT_MS);
  }

  /** Puts what was changed into a form that was drawn anew. */
  function fillInDraft(draft) {
    if (!draft.form || !byId("dataset")) return;
    document.querySelectorAll("#opening [data-form]").forEach((field) => { field.value = draft.form.fields[field.dataset.form] ?? field.value; });
    document.querySelectorAll("#opening [data-column]").forEach((field) => {
      field.value = (draft.form.columns[field.dataset.column] || {})[field.dataset.what] ?? field.value;
    });
    byId("dataset").value = draft.text ?? byId("dataset").value;
  }

  /** Where the keyboard is, so that it can go on there when its button is replaced. */
  function focused() {
    const element = document.activeElement;
    const piece = element && element.closest("[data-piece]");
    if (!piece) return null;
    const alike = [...piece.querySelectorAll("button")].filter((other) => other.dataset.act === element.dataset.act);
    return { piece, act: element.dataset.act, place: alike.indexOf(element) };
  }

  function focusAgain(before) {
    if (!before || !before.act) return;
    const alike = [...before.piece.querySelectorAll("button")].filter((other) => other.dataset.act === before.act);
    const next = alike[Math.min(Math.max(before.place, 0), alike.length - 1)] || byId("button-undo");
    next.focus({ preventScroll: true });
  }

  async function draw() {
    if (drawing) {
      again = true;
      return;
    }
    drawing = true;
    try {
      do {
        again = false;
        const view = await (await ask("view.json")).json();
        const before = focused() || held;
        for (const [name, html] of Object.entries(view.pieces)) {
          // What is the same stays: somebody may be typing there.
          if (drawn.get(name) === html) continue;
          document.querySelectorAll(`[data-piece="${name}"]`).forEach((place) => { place.innerHTML = html; });
          drawn.set(name, html);
          if (name === "opening") fillInDraft((next && next.form && { form: next.form }) || view.draft);
        }
        model = view.model;
        known = view.known;
        ended = view.ended;
        leftOut = view.left_out;
        document.title = `${document.querySelector("h1").textContent} – Armtrue workbench`;
        document.body.classList.toggle("nothing-open", model === "none");
        show(view);
        if (!busy) {
          focusAgain(before);
          held = null;
        }
        lookAgain();
      } while (again);
    } catch (error) {
      fail(error.message);
    } finally {
      drawing = false;
    }
  }

  /** What changes while an action runs: the buttons, the progress and the sentences. */
  function show(event) {
    busy = event.task !== null;
    document.body.setAttribute("aria-busy", String(busy));
    for (const [name, can] of Object.entries(event.buttons)) byId(`button-${name}`).disabled = !can;
    document.querySelectorAll("[data-piece] button[data-act]").forEach((button) => {
      const waits = button.dataset.source === "form" && event.task !== null && event.task.name === "open";
      button.disabled = busy && !waits && !BESIDE_WORK.includes(button.dataset.act);
    });
    byId("diagnosing").hidden = !event.diagnosing;
    if (event.diagnosing) {
      byId("diagnosing-share").value = event.diagnosing.share;
      byId("diagnosing-stage").textContent = event.diagnosing.stage;
    }
    diagnosing = event.diagnosing !== null;
    if ((!busy || event.first_figures) && byId("status").textContent !== event.said) byId("status").textContent = event.said;
    if (event.failure || !busy) fail(event.failure);
    clearTimeout(waitingForProgress);
    if (!busy) byId("running").hidden = true;
    else if (byId("running").hidden) waitingForProgress = setTimeout(() => { byId("running").hidden = false; }, SHOW_PROGRESS_AFTER_MS);
    byId("pause").hidden = !busy || event.task.name !== "refine";
    byId("pause").disabled = event.pausing;
    if (busy) {
      byId("progress").value = event.task.share;
      byId("stage").textContent = event.pausing ? "Refine pauses when this step ends" : event.task.stage || event.task.name;
    } else if (next) {
      const words = next;
      next = null;
      if (byId("dataset")) act(words);
    }
  }

  function listen() {
    const events = new EventSource("changes");
    events.onmessage = (message) => {
      const event = JSON.parse(message.data);
      // Events that follow one another quickly come as one: the last.
      if (event.known !== known || event.ended !== ended || (diagnosing && event.diagnosing === null)) draw();
      else show(event);
      if (wanted && event.task === null && event.made) {
        if (!event.failure) save(event.made);
        wanted = null;
      }
    };
    events.onerror = () => {
      if (events.readyState === EventSource.CLOSED) setTimeout(listen, REACH_AGAIN_MS);
      fail(SILENT);
      clearTimeout(waitingForProgress);
      for (const name of ["running", "diagnosing"]) byId(name).hidden = true; // the next event shows them again
    };
    events.onopen = () => fail("");
  }

  function save(name) {
    const link = document.createElement("a");
    link.href = "file?name=made";
    link.download = name;
    document.body.append(link);
    link.click();
    link.remove();
  }

  /** Fill the open parts below that do not show this model yet. */
  function lookAgain() {
    document.querySelectorAll("details.looking[open]").forEach(look);
  }

  async function look(details) {
    const shown = String(OF_THE_DIAGNOSIS.includes(details.dataset.panel) ? known : model);
    if (model === null || model === "none" || details.dataset.model === shown) return;
    details.dataset.model = shown;
    const slot = details.querySelector(".panel-slot");
    slot.setAttribute("aria-busy", "true");
    try {
      const html = await (await ask(`panel?name=${encodeURIComponent(details.dataset.panel)}&${details.dataset.query || ""}`)).text();
      if (details.dataset.model !== shown) return;
      slot.innerHTML = html;
      slot.querySelectorAll(".viewer").forEach(globalThis.armtrueReport.start);
      globalThis.armtrueLooking.start(slot);
    } catch (error) {
      slot.textContent = error.message;
      details.dataset.model = "";
    } finally {
      slot.removeAttribute("aria-busy");
    }
  }

  async function showCard(address) {
    const dialog = byId("card-dialog");
    byId("card").textContent = "It is being worked out…";
    dialog.showModal();
    try {
      byId("card").innerHTML = await (await ask(address)).text();
      if (matchMedia("(prefers-reduced-motion: reduce)").matches) byId("card").querySelectorAll("[data-act=hold]").forEach(hold);
      byId("card").querySelectorAll("[data-later]").forEach((place) => fill(place));
    } catch (error) {
      byId("card").textContent = error.message;
    }
  }

  /** Rings poses on the picture of the arm. */
  function ring(rows) {
    byId("card-dialog").close();
    document.querySelectorAll(".viewer").forEach((viewer) => viewer.dispatchEvent(new CustomEvent("armtrue-select", { detail: rows })));
    document.querySelector(".scene-part").scrollIntoView();
  }

  /** What takes longer to work out than the card that it stands on. */
  async function fill(place, address = place.dataset.later) {
    try {
      place.innerHTML = await (await ask(address)).text();
    } catch (error) {
      place.textContent = error.message;
    }
  }

  /** Stops a picture that moves where its displacement is largest, or lets it go on. */
  function hold(button) {
    const picture = button.closest("figure").querySelector("svg");
    const held = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(held));
    button.textContent = held ? "Let it move" : "Hold still";
    if (!held) return void picture.unpauseAnimations();
    picture.pauseAnimations();
    picture.setCurrentTime(Number(picture.dataset.still));
  }

  document.addEventListener("click", (event) => {
    const button = event.target.closest("button[data-act]");
    if (button && !button.disabled) press(button);
  });
  async function take(files) {
    fail("");
    let sentence = "";
    try {
      for (const file of files) await ask(`drop?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file });
    } catch (error) {
      sentence = error.message;
    }
    await draw();
    if (sentence) fail(sentence);
  }
  function offerToMark(rows) {
    picked = rows;
    byId("mark").textContent = rows.length === 1 ? `Mark row ${rows[0]} as wrong` : `Mark ${rows.length} rows as wrong`;
    byId("mark").hidden = !rows.length;
  }
  document.addEventListener("armtrue-read", (event) => {
    if (event.target.closest(".scene-part")) offerToMark(event.detail);
  });
  // Another variable or direction is wanted of a part that is open already.
  document.addEventListener("armtrue-look", (event) => {
    const details = document.querySelector("details[data-panel=state]");
    details.dataset.query = new URLSearchParams(event.detail).toString();
    details.dataset.model = "";
    look(details);
  });
  for (const kind of ["input", "change"]) byId("opening").addEventListener(kind, (event) => {
    const ofForm = event.target.closest("[data-form], [data-column]");
    if (ofForm || event.target.closest("#dataset")) keepDraft();
    if (!ofForm || kind !== "change") return;
    clearTimeout(waitingForDraft);
    act({ do: "open", look: true, form: filledIn() });
  });
  byId("files").addEventListener("change", async () => {
    await take([...byId("files").files]);
    byId("files").value = "";
  });
  document.addEventListener("dragover", (event) => event.preventDefault());
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    if (event.dataTransfer.files.length) take([...event.dataTransfer.files]);
  });
  document.addEventListener("keydown", (event) => {
    if (event.target.closest("input, select, textarea")) return;
    const key = event.key.toLowerCase();
    if ((event.ctrlKey || event.metaKey) && (key === "z" || key === "y")) {
      event.preventDefault();
      act({ do: key === "y" || event.shiftKey ? "redo" : "undo" });
    } else if (event.key === "Escape" && (busy || diagnosing) && !byId("card-dialog").open) {
      act({ do: "cancel" });
    }
  });
  document.querySelectorAll("details.looking").forEach((details) => details.addEventListener("toggle", () => {
    if (details.open) look(details);
  }));
  /** What the device does, as long as the page is looked at. */
  async function watch() {
    const place = byId("live");
    if (place && document.visibilityState === "visible") await fill(place, "device");
    setTimeout(watch, WATCH_MS);
  }

  document.documentElement.classList.add("script");
  watch();
  draw().then(listen);
})();
