// Keeps the page as the daemon has it: it listens to /api/events, and where that
// does not work it asks every few seconds. All text comes escaped in the page
// itself, or is set as text, never as HTML.
'use strict';
(() => {
  // In front of every path of the daemon.
  const base = document.documentElement.dataset.base;
  let busy = false;
  let again = false;

  async function refresh() {
    if (busy) {
      again = true;
      return;
    }
    busy = true;
    try {
      const answer = await fetch(base + '/', { cache: 'no-store' });
      const page = new DOMParser().parseFromString(await answer.text(), 'text/html');
      const fresh = page.querySelector('main');
      if (answer.ok && fresh) document.querySelector('main').replaceWith(fresh);
    } catch {
      // The daemon is away; the next turn asks again.
    }
    setTimeout(() => {
      busy = false;
      if (again) {
        again = false;
        refresh();
      }
    }, 500);
  }

  function progress(event) {
    const now = JSON.parse(event.data);
    const row = document.getElementById('job-' + now.id);
    if (!row) return;
    const left = now.seconds_left === null ? '' : `, ${now.seconds_left.toFixed(0)} s left in this stage`;
    row.lastElementChild.textContent =
      `${now.stage} ${now.percent.toFixed(0)} %, ${now.points_per_second.toFixed(0)} points/s${left}`;
  }

  // A picture turns while it is looked at: under the pointer, or with the focus
  // on its link. It rests where little movement is wished for.
  const still = matchMedia('(prefers-reduced-motion: reduce)');
  function turn(event) {
    const picture = event.target.closest('.thumb a')?.querySelector('img[data-turning]');
    if (!picture) return;
    const on = event.type === 'mouseover' || event.type === 'focusin';
    if (on && !still.matches && !picture.dataset.resting) {
      picture.dataset.resting = picture.src;
      picture.src = picture.dataset.turning;
    } else if (!on && picture.dataset.resting) {
      picture.src = picture.dataset.resting;
      delete picture.dataset.resting;
    }
  }
  for (const kind of ['mouseover', 'mouseout', 'focusin', 'focusout']) {
    document.addEventListener(kind, turn);
  }

  // What lies in the folders and waits is in no event.
  let poll = setInterval(refresh, 10000);
  const events = new EventSource(base + '/api/events');
  events.addEventListener('job', refresh);
  events.addEventListener('progress', progress);
  events.addEventListener('error', () => {
    // Refused, it does not try again by itself.
    if (events.readyState !== EventSource.CLOSED) return;
    clearInterval(poll);
    poll = setInterval(refresh, 2000);
  });
})();
