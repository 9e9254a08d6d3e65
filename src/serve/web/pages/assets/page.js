// What makes a page handier where scripts run. Without them all of it works too.
import { live } from './live.js';
import { upload } from './upload.js';

const still = matchMedia('(prefers-reduced-motion: reduce)');

// Shows what only works with scripts; called again after the page was renewed.
function enhance() {
  for (const box of document.querySelectorAll('#pick-all')) box.hidden = false;
  count();
  age();
  const turn = document.querySelector('#turn');
  if (turn && !still.matches) turn.hidden = false;
}

// A picture of the list turns while it is looked at: under the pointer, or with
// the focus on its link. It rests where little movement is wished for.
function look(event) {
  const picture = event.target.closest?.('td.pic a')?.querySelector('img[data-turning]');
  if (!picture) return;
  const on = event.type === 'mouseover' || event.type === 'focusin';
  if (on && !still.matches && !picture.dataset.resting) {
    picture.dataset.resting = picture.getAttribute('src');
    picture.src = picture.dataset.turning;
  } else if (!on && picture.dataset.resting) {
    picture.src = picture.dataset.resting;
    delete picture.dataset.resting;
  }
}
for (const kind of ['mouseover', 'mouseout', 'focusin', 'focusout']) document.addEventListener(kind, look);

document.addEventListener('click', async event => {
  const button = event.target.closest?.('button');
  if (!button) return;
  if (button.matches('.copy')) {
    const url = button.dataset.copyUrl;
    const text = url ? button.dataset.copy.replace(url, () => new URL(url, location.href).href) : button.dataset.copy;
    const label = button.dataset.label ?? (button.dataset.label = button.textContent);
    button.textContent = await copy(text) ? 'Copied' : 'Press Ctrl+C';
    setTimeout(() => { button.textContent = label; }, 2000);
  } else if (button.id === 'turn') {
    const picture = document.querySelector('#turntable');
    const turns = button.getAttribute('aria-pressed') === 'true';
    picture.dataset.moving ??= picture.getAttribute('src');
    picture.src = turns ? picture.dataset.still : picture.dataset.moving;
    button.setAttribute('aria-pressed', String(!turns));
    button.textContent = turns ? 'Turn' : 'Stop turning';
  } else if (button.id === 'notify') {
    await notify(button);
  }
});

// The clipboard is there on secure pages only; elsewhere the text is chosen.
async function copy(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    const field = document.createElement('textarea');
    field.value = text;
    document.body.append(field);
    field.select();
    const done = document.execCommand('copy');
    field.remove();
    return done;
  }
}

function count() {
  const chosen = document.querySelector('#chosen');
  if (chosen) chosen.textContent = document.querySelectorAll('input[name=job]:checked').length;
}

document.addEventListener('change', event => {
  if (event.target.id === 'pick-all') {
    for (const box of document.querySelectorAll('input[name=job]')) box.checked = event.target.checked;
  }
  if (event.target.matches('#pick-all, input[name=job]')) count();
  // Another order is shown at once.
  if (event.target.matches('#sort')) event.target.form.submit();
});

// A page that nothing happens on grows older all the same, by the daemon's clock.
const ahead = Number(document.body.dataset.now ?? Date.now()) - Date.now();
function age() {
  for (const time of document.querySelectorAll('time.ago')) {
    const text = ago((Date.now() + ahead - Date.parse(time.dateTime)) / 1000);
    if (time.textContent !== text) time.textContent = text;
  }
}
setInterval(age, 10_000);

// As the page itself says it.
function ago(seconds) {
  if (seconds < -60) return 'in the future';
  if (seconds < 5) return 'just now';
  if (seconds < 60) return `${Math.floor(seconds)} s ago`;
  if (seconds < 3600) return `${Math.floor(seconds / 60)} min ago`;
  if (seconds < 86400) return `${Math.floor(seconds / 3600)} h ago`;
  return seconds < 172800 ? 'yesterday' : `${Math.floor(seconds / 86400)} days ago`;
}

// What asks is closed by Escape, by another that is opened, and by a click elsewhere.
function close(but) {
  for (const open of document.querySelectorAll('details.confirm[open]')) {
    if (open !== but) open.open = false;
  }
}
document.addEventListener('keydown', event => {
  if (event.key !== 'Escape') return;
  const open = document.querySelector('details.confirm[open]');
  if (open?.contains(document.activeElement)) open.querySelector('summary').focus();
  close();
});
document.addEventListener('click', event => close(event.target.closest?.('details.confirm')));

// Notifications: only on request, kept in this browser.
const WANTED = 'lodestone-notify';
const button = document.querySelector('#notify');
const wanted = () => localStorage.getItem(WANTED) === 'yes' && Notification.permission === 'granted';
function label() {
  button.setAttribute('aria-pressed', String(wanted()));
  button.textContent = wanted() ? 'Notifies you' : 'Notify me';
}
async function notify() {
  if (wanted()) localStorage.removeItem(WANTED);
  else if (await Notification.requestPermission() === 'granted') localStorage.setItem(WANTED, 'yes');
  label();
}
if (button && 'Notification' in window && window.isSecureContext) {
  button.hidden = false;
  label();
}

function ended(jobs) {
  if (!button || button.hidden || !wanted()) return;
  try {
    tell(jobs);
  } catch {
    // Browsers of phones have the permission, and no way to show one from a page.
    localStorage.removeItem(WANTED);
    button.hidden = true;
  }
}

function tell(jobs) {
  if (jobs.length > 3) {
    const failed = jobs.filter(job => job.state !== 'done').length;
    new Notification('Lodestone', { body: `${jobs.length} jobs ended, ${failed} of them failed`, tag: 'lodestone' });
    return;
  }
  for (const job of jobs) new Notification(job.name, { body: job.state, tag: `lodestone-${job.id}` });
}

enhance();
upload();
live({ enhance, ended, stays: () => Boolean(button && !button.hidden && wanted()) });
