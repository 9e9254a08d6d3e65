// Files and folders that are dropped on the page, or chosen, are sent with a bar
// each. A folder goes in one piece, so that no half of it is ever converted.

// Sent at the same time.
const AT_ONCE = 2;
// After a cut, how often it is begun anew, and after what pause.
const TRIES = 5;
const PAUSE = 3000;
const CLOUD = /\.(las|laz)$/i;
const MARKER = /(^|\/)lodestone\.json$/;

export function upload() {
  const zone = document.querySelector('#drop');
  if (!zone) return;
  const list = zone.querySelector('.uploads');
  const form = zone.querySelector('form');
  const waiting = [];
  let running = 0;

  // The whole page takes what is dropped, for nobody aims well.
  for (const kind of ['dragenter', 'dragover']) {
    addEventListener(kind, event => {
      if (![...event.dataTransfer?.types ?? []].includes('Files')) return;
      event.preventDefault();
      zone.classList.add('over');
    });
  }
  addEventListener('dragleave', event => {
    if (!event.relatedTarget) zone.classList.remove('over');
  });
  addEventListener('drop', async event => {
    if (!event.dataTransfer?.files.length && !event.dataTransfer?.items.length) return;
    event.preventDefault();
    zone.classList.remove('over');
    take(await dropped(event.dataTransfer));
  });
  form.addEventListener('submit', event => {
    event.preventDefault();
    choose();
  });
  for (const input of form.querySelectorAll('input[type=file]')) input.addEventListener('change', choose);

  function choose() {
    for (const input of form.querySelectorAll('input[type=file]')) {
      take([...input.files].map(file => ({ file, path: file.webkitRelativePath || file.name })));
      input.value = '';
    }
  }

  function take(files) {
    const parts = new Map();
    for (const one of files) {
      const top = one.path.split('/')[0];
      if (!parts.has(top)) parts.set(top, []);
      parts.get(top).push(one);
    }
    for (const [name, all] of parts) {
      const wanted = all.filter(one => CLOUD.test(one.path) || MARKER.test(one.path));
      const row = line(name);
      if (wanted.some(one => CLOUD.test(one.path))) waiting.push({ row, files: wanted, tries: 0 });
      else row.end(`is no LAS or LAZ${all.length > 1 ? ', and holds none' : ''}; PDAL or CloudCompare turns other formats into LAZ`, 'bad');
    }
    next();
  }

  function line(name) {
    const item = document.createElement('li');
    const label = document.createElement('span');
    const bar = document.createElement('progress');
    const says = document.createElement('span');
    const stop = document.createElement('button');
    label.textContent = `${name} `;
    bar.max = 1;
    bar.value = 0;
    bar.setAttribute('aria-label', `Upload of ${name}`);
    says.className = 'says';
    says.setAttribute('role', 'status');
    says.textContent = 'waits';
    stop.type = 'button';
    stop.className = 'quiet';
    stop.textContent = 'Stop';
    item.append(label, says, stop, bar);
    list.prepend(item);
    return {
      bar, says, stop, stopped: false,
      end(text, kind) {
        bar.remove();
        stop.remove();
        says.textContent = text;
        item.dataset.end = kind;
        if (kind === 'good') setTimeout(() => item.remove(), 8000);
      },
    };
  }

  function next() {
    while (running < AT_ONCE && waiting.length) send(waiting.shift());
  }

  function send(part) {
    const { row, files } = part;
    if (row.stopped) return next();
    running += 1;
    const data = new FormData();
    for (const { file, path } of files) data.append('files', file, path);
    const total = files.reduce((sum, { file }) => sum + file.size, 0);
    const request = new XMLHttpRequest();
    const began = performance.now();
    row.stop.onclick = () => {
      row.stopped = true;
      request.abort();
      row.end('stopped; nothing of it is left', 'bad');
    };
    request.upload.onprogress = ({ loaded }) => {
      const done = total ? Math.min(loaded / total, 1) : 1;
      const seconds = (performance.now() - began) / 1000;
      row.bar.value = done;
      row.says.textContent = done < 1
        ? `${size(loaded)} of ${size(total)}, ${size(loaded / Math.max(seconds, 0.1))}/s`
        : 'sent; is being written';
    };
    const over = () => {
      running -= 1;
      next();
    };
    request.onload = () => {
      let told = {};
      try { told = JSON.parse(request.responseText); } catch { /* said below */ }
      if (request.status === 200) row.end('arrived; it is in the list within seconds', 'good');
      else row.end(told.error ?? `was refused (${request.status})`, 'bad');
      over();
    };
    request.onerror = () => {
      part.tries += 1;
      if (part.tries < TRIES && !row.stopped) {
        row.says.textContent = 'the connection was cut; begins anew in a moment';
        setTimeout(() => { waiting.push(part); next(); }, PAUSE);
      } else {
        row.end('the connection was cut; nothing of it is left', 'bad');
      }
      over();
    };
    request.onabort = over;
    request.open('POST', form.action);
    request.setRequestHeader('Accept', 'application/json');
    request.send(data);
  }

  addEventListener('beforeunload', event => {
    if (running) event.preventDefault();
  });
}

function size(bytes) {
  const units = ['bytes', 'kB', 'MB', 'GB', 'TB'];
  let at = 0;
  while (bytes >= 1000 && at < units.length - 1) {
    bytes /= 1000;
    at += 1;
  }
  return `${bytes.toFixed(at && bytes < 100 ? 1 : 0)} ${units[at]}`;
}

// All files that were dropped, those of folders with their path.
async function dropped(transfer) {
  const entries = [...transfer.items].map(item => item.webkitGetAsEntry?.()).filter(Boolean);
  if (!entries.length) return [...transfer.files].map(file => ({ file, path: file.name }));
  const found = [];
  await Promise.all(entries.map(entry => walk(entry, found)));
  return found;
}

async function walk(entry, found) {
  if (entry.isFile) {
    const file = await new Promise((resolve, reject) => entry.file(resolve, reject));
    found.push({ file, path: entry.fullPath.replace(/^\//, '') });
    return;
  }
  const reader = entry.createReader();
  for (;;) {
    // A reader gives a hundred at a time.
    const some = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
    if (!some.length) return;
    await Promise.all(some.map(one => walk(one, found)));
  }
}
