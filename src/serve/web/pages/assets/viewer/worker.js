// The loader's thread: choosing and composing take longer than a frame may.
import { Loader } from './loader.js';

let loader = null;

self.addEventListener('message', ({ data }) => {
  switch (data.type) {
    case 'open':
      loader?.end();
      loader = new Loader({
        ...data,
        fetch: (...request) => fetch(...request),
        post: message => self.postMessage({ ...message, revision: data.description.revision },
          message.scene ? [message.scene.buffer] : []),
      });
      break;
    case 'look': loader.look(data.view); break;
    case 'color': loader.color(data.by); break;
    case 'retry': loader.retry(); break;
    case 'rest': loader.rest(data.resting); break;
    case 'pick': self.postMessage({ type: 'picked', id: data.id, hit: loader.pick(data.pixel, data.radius) }); break;
    default: throw new Error(`unknown message ${data.type}`);
  }
});
