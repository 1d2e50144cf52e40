// What a page of the site does by itself: it remembers the answers to its cards, counts them, draws
// the questions of a checkpoint, and enlarges a picture. The simulations are live.js.

"use strict";
(() => {
  const KEY = "course.cards"; // in localStorage: card -> [answer, whether it was right]
  const make = (tag, options = {}, ...children) => {
    const element = Object.assign(document.createElement(tag), options);
    element.append(...children);
    return element;
  };

  // --- The answers to cards ----------------------------------------------------------------------

  let fallback = {}; // where nothing may be stored, answers last as long as the page
  const answers = () => {
    let stored = fallback;
    try {
      stored = JSON.parse(localStorage.getItem(KEY)) ?? fallback;
    } catch {
      // Nothing may be stored here, or somebody else stored something.
    }
    const good = ([, given]) => Array.isArray(given) && typeof given[0] === "string";
    return Object.fromEntries(Object.entries(stored).filter(good));
  };
  const store = (all) => {
    fallback = all;
    try {
      localStorage.setItem(KEY, JSON.stringify(all));
    } catch {
      // A private window, or no room: see `fallback`.
    }
  };

  const options = (card) => [...card.querySelectorAll("details[data-answer]")];

  // Show on a card which answer counts, if one has been given.
  function mark(card, given) {
    card.querySelector(":scope > .card-answered")?.remove();
    card.classList.toggle("answered", Boolean(given));
    for (const option of options(card))
      option.classList.toggle("chosen", given?.[0] === option.dataset.answer);
    if (!given) return;
    const [answer, right] = given;
    const verdict = make("strong", { textContent: right ? "Right" : "Not right" });
    const words = make("p", { className: `card-answered ${right ? "right" : "wrong"}` });
    words.append(verdict, `: your first answer was “${answer}”.`);
    words.setAttribute("role", "status");
    card.append(words);
  }

  // The first answer counts; the others can be read afterwards.
  function listen(card) {
    for (const option of options(card))
      option.addEventListener("toggle", () => {
        const all = answers();
        if (!option.open || all[card.dataset.card]) return;
        const right = option.dataset.right === "yes";
        store({ ...all, [card.dataset.card]: [option.dataset.answer, right] });
        const why = card.querySelector(":scope > details.why");
        if (why) why.open = true;
        refresh();
      });
  }

  function score(names) {
    const all = answers();
    const given = names.filter((name) => all[name]);
    return { of: names.length, given: given.length, right: given.filter((n) => all[n][1]).length };
  }
  const inWords = ({ of, given, right }) =>
    given ? `${right} right of ${given} answered, ${of} cards` : `none of ${of} cards answered`;

  function forget(names) {
    const all = answers();
    for (const name of names) delete all[name];
    store(all);
    for (const name of names)
      for (const card of document.querySelectorAll(`.card[data-card="${CSS.escape(name)}"]`))
        for (const details of card.querySelectorAll("details")) details.open = false;
    refresh();
  }
  const forgets = (names, label) => {
    const button = make("button", { type: "button", textContent: "Forget my answers" });
    button.setAttribute("aria-label", label);
    button.addEventListener("click", () => forget(names));
    return button;
  };

  const cards = [...document.querySelectorAll(".card[data-card]")].filter((card) => options(card)[0]);
  const here = [...new Set(cards.map((card) => card.dataset.card))];
  const shown = []; // what is written anew when an answer is given: functions

  function refresh() {
    const all = answers();
    for (const card of cards) mark(card, all[card.dataset.card]);
    for (const write of shown) write();
  }

  // The score of this page stands below its title.
  function countHere() {
    const words = make("span");
    const button = forgets(here, "Forget my answers to the cards of this page");
    const line = make("p", { className: "course-score" }, words, " ", button);
    document.querySelector("article h1")?.after(line);
    shown.push(() => {
      const counted = score(here);
      words.textContent = `Your answers: ${inWords(counted)}.`;
      button.hidden = !counted.given;
    });
  }

  // The home page has a row for each chapter, whose cards stand in its attribute.
  function countChapters(place) {
    const rows = [...place.querySelectorAll("[data-cards]")].map((row) => {
      const cell = row.querySelector(".score");
      return [row.dataset.cards.split(" ").filter(Boolean), cell];
    });
    const every = rows.flatMap(([names]) => names);
    const total = make("span");
    const button = forgets(every, "Forget all my answers");
    place.append(make("p", {}, total, " ", button));
    shown.push(() => {
      for (const [names, cell] of rows) cell.textContent = inWords(score(names));
      const counted = score(every);
      total.textContent = `All chapters: ${inWords(counted)}.`;
      button.hidden = !counted.given;
    });
  }

  // --- The checkpoint of a chapter -----------------------------------------------------------------

  const CHECKPOINT = "course.checkpoint"; // in localStorage: topic -> { seed, answers, passed }
  // As in `course.cards.draws`, which draws the same questions in a notebook.
  const PARTS = { derive: 1, estimate: 1, formula: 1, claim: 2 };

  // FNV-1a with the finaliser of MurmurHash3, on 32 bits.
  function rank(seed, key) {
    let h = 0x811c9dc5;
    for (const letter of `${seed}/${key}`) h = Math.imul(h ^ letter.charCodeAt(0), 0x01000193);
    h = Math.imul(h ^ (h >>> 16), 0x85ebca6b);
    h = Math.imul(h ^ (h >>> 13), 0xc2b2ae35);
    return (h ^ (h >>> 16)) >>> 0;
  }

  // No two questions of a draw share a claim, and its claims have different verdicts.
  function drawn(questions, seed) {
    const ranked = questions.map((one) => [rank(seed, one.dataset.key), one]);
    ranked.sort(([a, x], [b, y]) => a - b || (x.dataset.key < y.dataset.key ? -1 : 1));
    const result = [];
    for (const [part, count] of Object.entries(PARTS))
      for (let k = 0; k < count; k += 1) {
        const fits = ([, { dataset }]) =>
          (dataset.part === part || (part === "formula" && dataset.part === "derive"))
          && !result.some((other) => other.dataset.claim === dataset.claim)
          && !(dataset.verdict && result.some((other) => other.dataset.verdict === dataset.verdict));
        const next = ranked.find(fits);
        if (next) result.push(next[1]);
      }
    return result;
  }

  let checkpoints = {}; // where nothing may be stored, they last as long as the page
  function readCheckpoint(topic) {
    let stored = checkpoints;
    try {
      stored = JSON.parse(localStorage.getItem(CHECKPOINT)) ?? checkpoints;
    } catch {
      // Nothing may be stored here, or somebody else stored something.
    }
    const { seed, answers: given, passed } = Object(Object(stored)[topic]);
    const good = ([, one]) => Array.isArray(one) && typeof one[0] === "string";
    return {
      seed: Number.isInteger(seed) && seed > 0 ? seed : 1,
      answers: Object.fromEntries(Object.entries(Object(given)).filter(good)),
      passed: passed === true,
    };
  }
  function storeCheckpoint(topic, state) {
    let all = checkpoints;
    try {
      all = Object(JSON.parse(localStorage.getItem(CHECKPOINT)) ?? checkpoints);
    } catch {
      // As above.
    }
    checkpoints = { ...all, [topic]: state };
    try {
      localStorage.setItem(CHECKPOINT, JSON.stringify(checkpoints));
    } catch {
      // A private window, or no room: see `checkpoints`.
    }
  }

  function checkpoint(box) {
    const { topic } = box.dataset;
    const questions = [...box.querySelectorAll(".checkpoint-question")];
    const words = make("span");
    words.setAttribute("role", "status");
    const again = make("button", { type: "button", textContent: "New questions" });
    box.prepend(make("p", { className: "course-score" }, words, " ", again));

    // The first answer to a question counts until others are drawn.
    function give(question, answer, right) {
      const state = readCheckpoint(topic);
      if (state.answers[question.dataset.key]) return;
      state.answers[question.dataset.key] = [answer, right];
      const mine = drawn(questions, state.seed);
      state.passed ||= mine.every((one) => state.answers[one.dataset.key]?.[1]);
      storeCheckpoint(topic, state);
      question.querySelector(":scope > details.why").open = true;
      write();
    }

    function entry(question) {
      const { value, factor, unit } = question.dataset;
      const number = make("input", { type: "text", inputMode: "decimal", size: 10 });
      number.setAttribute("aria-label", unit ? `Your estimate in ${unit}` : "Your estimate");
      const send = make("button", { type: "submit", textContent: "Check" });
      const form = make("form", { className: "checkpoint-entry" }, number, ` ${unit} `, send);
      form.addEventListener("submit", (event) => {
        event.preventDefault();
        const typed = Number(number.value);
        const wrong = number.value.trim() === "" || !Number.isFinite(typed);
        number.setCustomValidity(wrong ? "Type a number, such as 0.25 or 2.5e-1." : "");
        if (!form.reportValidity()) return;
        const share = typed / Number(value);
        const right = share > 0 && Math.abs(Math.log(share)) <= Math.log(Number(factor));
        give(question, `${number.value.trim()} ${unit}`.trim(), right);
      });
      number.addEventListener("input", () => number.setCustomValidity(""));
      question.querySelector(":scope > details.why").before(form);
    }

    for (const question of questions) {
      if (question.dataset.part === "estimate") entry(question);
      for (const option of options(question))
        option.addEventListener("toggle", () => {
          if (option.open) give(question, option.dataset.answer, option.dataset.right === "yes");
        });
    }
    again.addEventListener("click", () => {
      const { seed, passed } = readCheckpoint(topic);
      storeCheckpoint(topic, { seed: seed + 1, answers: {}, passed });
      for (const details of box.querySelectorAll("details")) details.open = false;
      for (const form of box.querySelectorAll("form")) form.reset();
      write();
    });

    function write() {
      const { seed, answers: given, passed } = readCheckpoint(topic);
      const mine = drawn(questions, seed);
      for (const question of questions) {
        question.hidden = !mine.includes(question);
        mark(question, given[question.dataset.key]);
      }
      for (const question of mine) box.append(question); // in the order of the draw
      const results = mine.map((one) => given[one.dataset.key]).filter(Boolean);
      const right = results.filter(([, good]) => good).length;
      words.textContent = `Draw ${seed}: ${right} right of ${results.length} answered, `
        + `${mine.length} questions. Checkpoint ${passed ? "passed" : "open"}.`;
    }
    shown.push(write);
  }

  // --- Where a reader was --------------------------------------------------------------------------

  const LAST = "course.page"; // in localStorage: file, title, section and its title
  const chapterHere = location.pathname.match(/\/(\d\d_\w+\.html)$/)?.[1];

  // A chapter's page notes the section that is on the screen when the reader leaves it.
  function note() {
    const sections = [...document.querySelectorAll("article section[id]")];
    const above = sections.filter((e) => e.getBoundingClientRect().top < innerHeight / 2);
    const last = above.at(-1);
    const words = (e) => e?.querySelector(":is(h1,h2,h3,h4)")?.firstChild?.textContent ?? "";
    try {
      const where = [chapterHere, words(sections[0]), last?.id ?? "", words(last)];
      localStorage.setItem(LAST, JSON.stringify(where));
    } catch {
      // Nothing may be stored here; then the home page begins with chapter 0.
    }
  }

  // The home page leads back there, below its doors.
  function goOn(doors) {
    let where = null;
    try {
      where = JSON.parse(localStorage.getItem(LAST));
    } catch {
      // Somebody else stored something.
    }
    const good = Array.isArray(where) && where.length === 4 && where.every((e) => typeof e === "string");
    if (!good || !/^\d\d_\w+\.html$/.test(where[0])) return;
    const [file, title, id, section] = where;
    const href = id ? `${file}#${encodeURIComponent(id)}` : file;
    const words = section && section !== title ? `${title}: ${section}` : title;
    const link = make("a", { href, textContent: words });
    doors.before(make("p", { className: "course-go-on" }, "Go on where you were: ", link));
  }

  // --- The page of all claims ----------------------------------------------------------------------

  const SHOWN = 20; // claims on one page of the list
  const VERDICTS = { "": "Every verdict", holds: "True", false: "False", "holds only if": "True only if" };

  // Filters, pages and a quiz. Without this script the page shows all claims below each other.
  function browse(claims) {
    let [start, quiz] = [0, false];
    const opened = new Set(); // claims whose verdict the reader asked for while verdicts are hidden
    const select = (label, options) => {
      const menu = make("select", {}, ...options.map(([value, textContent]) =>
        make("option", { value, textContent })));
      menu.setAttribute("aria-label", label);
      menu.addEventListener("change", () => ((start = 0), list()));
      return menu;
    };
    const heads = [...document.querySelectorAll("article section > h2")];
    const titles = heads.map((h) => h.firstChild.textContent);
    const chapter = select("Chapter", [["", "Every chapter"],
      ...titles.map((title) => [title.split(" ")[0], title])]);
    const verdict = select("Verdict", Object.entries(VERDICTS));
    const hide = make("input", { type: "checkbox" });
    hide.addEventListener("change", () => (opened.clear(), list()));
    const ask = make("button", { type: "button", textContent: "Quiz me" });
    ask.addEventListener("click", () => {
      // Ten claims of the chosen chapter in random order, verdicts hidden.
      quiz = !quiz;
      [hide.checked, start] = [quiz || hide.checked, 0];
      if (quiz) {
        verdict.value = "";
        opened.clear();
        order = fitting().map((e) => [Math.random(), e]).sort(([a], [b]) => a - b);
        order = order.slice(0, 10).map(([, e]) => e);
        [right, given] = [0, 0];
      }
      list();
    });
    let [order, right, given] = [[], 0, 0];
    const count = make("span");
    count.setAttribute("role", "status");
    const step = (words, by) => {
      const button = make("button", { type: "button", textContent: words });
      button.addEventListener("click", () => {
        start += by;
        list();
        bar.scrollIntoView({ block: "start" });
      });
      return button;
    };
    // Above the list and below it.
    const steps = [0, 1].map(() => [step("Previous", -SHOWN), step("Next", SHOWN)]);
    const bar = make("div", { className: "course-browse" },
      chapter, verdict, make("label", {}, hide, " hide the verdict"), ask, count, ...steps[0]);
    const foot = make("div", { className: "course-browse" }, ...steps[1]);
    claims[0].closest("section").before(bar);
    claims.at(-1).closest("section").after(foot);
    const fitting = () => claims.filter(({ dataset }) =>
      (!chapter.value || dataset.chapter === chapter.value)
      && (!verdict.value || dataset.verdict === verdict.value));

    // While verdicts are hidden a claim has three answers; one click opens its verdict.
    for (const claim of claims) {
      const answers = make("p", { className: "course-guess" });
      for (const [value, textContent] of Object.entries(VERDICTS).slice(1)) {
        const button = make("button", { type: "button", textContent });
        button.addEventListener("click", () => {
          given += 1;
          right += value === claim.dataset.verdict;
          opened.add(claim);
          list();
        });
        answers.append(button);
      }
      claim.querySelector(".course-verdict").before(answers);
    }
    function list() {
      const chosen = quiz ? order : fitting();
      start = Math.min(Math.max(start, 0), Math.max(0, chosen.length - 1));
      start -= start % SHOWN;
      const visible = new Set(chosen.slice(start, start + SHOWN));
      for (const claim of claims) {
        claim.hidden = !visible.has(claim);
        const open = !hide.checked || opened.has(claim);
        claim.querySelector(".course-verdict").hidden = !open;
        claim.querySelector(".course-guess").hidden = open;
      }
      for (const head of heads)
        head.hidden = ![...head.parentElement.querySelectorAll(".course-claim")].some((e) => !e.hidden);
      ask.textContent = quiz ? "End the quiz" : "Quiz me";
      chapter.disabled = verdict.disabled = quiz;
      const end = Math.min(start + SHOWN, chosen.length);
      count.textContent = quiz ? `${right} right of ${given} answered, ${chosen.length} claims`
        : `${chosen.length ? start + 1 : 0} to ${end} of ${chosen.length} claims`;
      for (const [before, after] of steps) {
        before.disabled = start === 0;
        after.disabled = end >= chosen.length;
      }
      foot.hidden = chosen.length <= SHOWN;
    }
    // A link to one claim shows the page of the list that it is on.
    const enter = () => {
      const aim = claims.find((claim) => claim.id === decodeURIComponent(location.hash.slice(1)));
      if (aim) {
        [chapter.value, verdict.value, quiz] = ["", "", false];
        start = claims.indexOf(aim);
      }
      list();
      aim?.scrollIntoView();
    };
    addEventListener("hashchange", enter);
    enter();
  }

  // --- Pictures ----------------------------------------------------------------------------------

  const picture = make("img", { alt: "The enlarged picture" });
  const close = make("button", { type: "submit", textContent: "Close" });
  const form = make("form", { method: "dialog" }, close);
  const large = make("dialog", { className: "course-large" }, form, make("div", {}, picture));
  large.setAttribute("aria-label", "Enlarged picture");
  large.addEventListener("click", (event) => {
    if (event.target === large) large.close(); // beside the picture
  });

  // A link to the picture, so that it has the focus and opens without this script too.
  function enlarges(image) {
    const link = make("a", { className: "course-enlarge", href: image.src, title: "Enlarge" });
    const whole = image.parentElement.tagName === "PICTURE" ? image.parentElement : image;
    whole.replaceWith(link);
    link.append(whole);
    link.addEventListener("click", (event) => {
      if (event.ctrlKey || event.metaKey || event.shiftKey) return;
      event.preventDefault();
      picture.src = image.currentSrc || image.src;
      picture.alt = image.alt;
      large.showModal();
    });
  }

  function begin() {
    for (const card of cards) listen(card);
    if (here.length) countHere();
    for (const place of document.querySelectorAll(".course-scores")) countChapters(place);
    for (const box of document.querySelectorAll(".course-checkpoint")) checkpoint(box);
    const claims = [...document.querySelectorAll(".course-claim[data-verdict]")];
    if (claims.length) browse(claims);
    const doors = document.querySelector(".course-doors");
    if (doors) goOn(doors);
    if (chapterHere) {
      note();
      addEventListener("pagehide", note);
      document.addEventListener("visibilitychange", note);
    }
    refresh();
    // An answer that is given in another window counts here too.
    addEventListener("storage", ({ key }) => [KEY, CHECKPOINT].includes(key) && refresh());
    document.body.append(large);
    for (const image of document.querySelectorAll("article img"))
      if (!image.closest(".course-live, a")) enlarges(image);
  }
  begin();
})();
