// Where nothing can be drawn: the turntable, turned by hand, and why.

// Shows the turntable; `why` is a sentence.
export async function fallBack(why) {
  document.body.dataset.mode = 'turntable';
  document.querySelector('#fallback-why').textContent = `There is no live view here: ${why}. The picture can be turned instead.`;
  document.querySelector('#says').textContent = '';
  const picture = document.querySelector('#turntable');
  if (!picture) return;
  const frames = await decoded(picture).catch(() => []);
  if (frames.length < 2) return;
  const canvas = document.querySelector('#turntable-hand');
  const angle = document.querySelector('#turntable-angle');
  [canvas.width, canvas.height] = [frames[0].width, frames[0].height];
  const context = canvas.getContext('2d');
  angle.max = frames.length - 1;
  const show = () => {
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.drawImage(frames[Number(angle.value)], 0, 0);
    angle.setAttribute('aria-valuetext', `${Math.round(angle.value / frames.length * 360)} degrees`);
  };
  angle.addEventListener('input', show);
  let from = null;
  canvas.addEventListener('pointerdown', event => {
    canvas.setPointerCapture(event.pointerId);
    from = { x: event.clientX, value: Number(angle.value) };
  });
  canvas.addEventListener('pointermove', event => {
    if (!from || !event.buttons) return;
    const turned = Math.round((event.clientX - from.x) / canvas.clientWidth * frames.length);
    angle.value = ((from.value - turned) % frames.length + frames.length) % frames.length;
    show();
  });
  picture.hidden = true;
  canvas.hidden = false;
  document.querySelector('#turntable-label').hidden = false;
  show();
}

// All frames of an animation, where the browser can take one apart.
async function decoded(picture) {
  if (!('ImageDecoder' in window)) return [];
  const answer = await fetch(picture.src);
  const decoder = new ImageDecoder({ data: answer.body, type: picture.dataset.type });
  await decoder.completed;
  await decoder.tracks.ready;
  const frames = [];
  for (let frame = 0; frame < decoder.tracks.selectedTrack.frameCount; frame += 1) {
    const { image } = await decoder.decode({ frameIndex: frame });
    frames.push(await createImageBitmap(image));
    image.close();
  }
  return frames;
}
