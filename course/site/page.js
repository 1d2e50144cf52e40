// What a page of the site does by itself: it remembers the answers to its cards, counts them, and
// enlarges a picture. The simulations are live.js.

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
    const [before, after] = [step("Previous", -SHOWN), step("Next", SHOWN)];
    const bar = make("div", { className: "course-browse" },
      chapter, verdict, make("label", {}, hide, " hide the verdict"), ask, count, before, after);
    claims[0].closest("section").before(bar);
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
      before.disabled = start === 0;
      after.disabled = end >= chosen.length;
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
    addEventListener("storage", (event) => event.key === KEY && refresh());
    document.body.append(large);
    for (const image of document.querySelectorAll("article img"))
      if (!image.closest(".course-live, a")) enlarges(image);
  }
  begin();
})();
