// Keeps the page as the daemon has it: it listens to /api/events, and where that
// does not work it asks every few seconds. All text comes escaped in the page
// itself, or is set as text, never as HTML.
'use strict';
(() => {
  let busy = false;
  let again = false;

  async function refresh() {
    if (busy) {
      again = true;
      return;
    }
    busy = true;
    try {
      const answer = await fetch('/', { cache: 'no-store' });
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

  // What lies in the folders and waits is in no event.
  let turn = setInterval(refresh, 10000);
  const events = new EventSource('/api/events');
  events.addEventListener('job', refresh);
  events.addEventListener('progress', progress);
  events.addEventListener('error', () => {
    // Refused, it does not try again by itself.
    if (events.readyState !== EventSource.CLOSED) return;
    clearInterval(turn);
    turn = setInterval(refresh, 2000);
  });
})();
