// What makes a page handier where scripts run. Without them all of it works too.
import { live } from './live.js';
import { upload } from './upload.js';

const still = matchMedia('(prefers-reduced-motion: reduce)');

// Shows what only works with scripts; called again after the page was renewed.
function enhance() {
  for (const button of document.querySelectorAll('button.copy, #pick-all')) button.hidden = false;
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
    const text = url ? new URL(url, location.href).href : button.dataset.copy;
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

document.addEventListener('change', event => {
  if (event.target.id !== 'pick-all') return;
  for (const box of document.querySelectorAll('input[name=job]')) box.checked = event.target.checked;
});

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
