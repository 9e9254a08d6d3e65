// Keeps a page as the daemon has it. The daemon says that something changed, the
// page fetches itself again and takes over what differs: what is chosen, opened or
// in focus stays. All text comes escaped in the page itself, or is set as text.

const base = document.body.dataset.base;
// Pages are not fetched more often, in milliseconds; while much happens, less often.
const PAUSE = 1500;
const LONGEST_PAUSE = 6000;
// How long it is said what came of an order.
const SAID = 10_000;
// Where no stream is to be had.
const POLL = 5000;

export function live({ enhance, ended, stays }) {
  if (base === undefined) return;
  const gone = document.querySelector('#gone');
  const own = /\/jobs\/(\d+)$/.exec(location.pathname)?.[1];
  let busy = false;
  let again = false;
  let pause = PAUSE;
  let stream = null;
  let poll = 0;

  async function refresh() {
    if (busy) {
      again = true;
      return;
    }
    busy = true;
    again = false;
    try {
      const answer = await fetch(location.href, { headers: { accept: 'text/html' }, cache: 'no-store' });
      if (answer.status === 401) {
        location.reload();
        return;
      }
      if (answer.ok) {
        const page = new DOMParser().parseFromString(await answer.text(), 'text/html');
        const fresh = page.querySelector('main');
        // What came of an order is said once, for as long as it takes to be read: the
        // order itself is news, which come at once.
        if (performance.now() > SAID) {
          for (const said of fresh.querySelectorAll(':scope > p.banner.good')) said.remove();
        }
        sync(document.querySelector('main'), fresh);
        enhance();
      }
      gone.hidden = answer.status < 502;
    } catch {
      gone.hidden = false;
    }
    setTimeout(() => {
      busy = false;
      pause = again ? Math.min(2 * pause, LONGEST_PAUSE) : PAUSE;
      if (again) refresh();
    }, pause);
  }

  function progress(event) {
    for (const job of JSON.parse(event.data)) {
      const place = document.querySelector(`[data-progress="${Number(job.id)}"]`);
      if (!place) continue;
      place.querySelector('.whole').value = job.whole;
      place.querySelector('.stage').value = job.stage;
      place.querySelector('.says').textContent = job.says;
    }
  }

  function changed(event) {
    const news = JSON.parse(event.data);
    ended(news.ended);
    // A job's page need not care for others.
    if (own === undefined || news.jobs === null || news.jobs.includes(Number(own))) refresh();
  }

  function listen() {
    stream = new EventSource(`${base}/live`);
    stream.addEventListener('changed', changed);
    stream.addEventListener('progress', progress);
    stream.addEventListener('open', () => {
      clearInterval(poll);
      // What happened while nobody listened, be it between the making of this page
      // and now.
      refresh();
      gone.hidden = true;
    });
    stream.addEventListener('error', () => {
      // Refused, it does not try again by itself; cut, it does.
      if (stream?.readyState === EventSource.CLOSED) {
        clearInterval(poll);
        poll = setInterval(refresh, POLL);
        refresh();
      } else {
        gone.hidden = false;
      }
    });
  }

  function rest() {
    stream?.close();
    stream = null;
    clearInterval(poll);
  }

  // A browser has few connections for all its tabs; one that nobody sees needs none.
  document.addEventListener('visibilitychange', () => {
    if (document.hidden && !stays()) {
      rest();
    } else if (!document.hidden && !stream) {
      listen();
    }
  });
  addEventListener('pagehide', rest);
  // Taken back from the history, the page is as it was left.
  addEventListener('pageshow', event => {
    if (event.persisted && !stream) listen();
  });
  listen();
}

// What the person did stays: opened details, pictures that turn, buttons shown.
const KEPT = { DETAILS: ['open'], IMG: ['src'], BUTTON: ['hidden', 'aria-pressed'], INPUT: ['hidden'] };

// Makes `old` what `fresh` is, changing no more than what differs.
function sync(old, fresh) {
  if (old.isEqualNode(fresh)) return;
  if (old.nodeType !== Node.ELEMENT_NODE) {
    old.nodeValue = fresh.nodeValue;
    return;
  }
  // A picture that turns shows another file than the page says.
  const moved = old.tagName !== 'IMG' || ((old.dataset.resting || old.dataset.moving)
    && old.dataset.turning === fresh.dataset.turning && old.dataset.still === fresh.dataset.still);
  const kept = moved ? KEPT[old.tagName] ?? [] : [];
  const mine = name => kept.includes(name) || ['data-resting', 'data-moving', 'data-label'].includes(name);
  for (const { name } of [...old.attributes]) {
    if (!fresh.hasAttribute(name) && !mine(name)) old.removeAttribute(name);
  }
  for (const { name, value } of [...fresh.attributes]) {
    if (old.getAttribute(name) !== value && !(mine(name) && (old.hasAttribute(name) || name === 'hidden' || name === 'open'))) old.setAttribute(name, value);
  }
  if (old.tagName === 'PROGRESS') old.value = fresh.value;
  if (old.matches('.uploads')) return;
  let at = old.firstChild;
  for (const want of [...fresh.childNodes]) {
    let match = null;
    if (want.id) match = [...old.children].find(child => child.id === want.id) ?? null;
    else if (at && !at.id && at.nodeName === want.nodeName) match = at;
    if (!match) {
      old.insertBefore(document.importNode(want, true), at);
      continue;
    }
    if (match === at) at = at.nextSibling;
    else old.insertBefore(match, at);
    sync(match, want);
  }
  while (at) {
    const next = at.nextSibling;
    at.remove();
    at = next;
  }
}
