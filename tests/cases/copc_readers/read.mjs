// Reads COPC files with copc.js, as Potree, iTowns and giro3d do: all pages of the
// hierarchy, all nodes, every point in its node's box by copc.js's own halving, and
// prints the number of points and the hash of all records, sorted, a line a file.
// Arguments: for each file its path and how many of its points have return number 0.

import { createHash } from 'node:crypto'
import { Bounds, Copc, Hierarchy, Key } from 'copc'
import { open } from 'node:fs/promises'

const must = (holds, text) => {
  if (!holds) throw new Error(text)
}

async function read(path, zeros) {
  const file = await open(path)
  const getter = async (begin, end) => {
    const bytes = new Uint8Array(end - begin)
    const { bytesRead } = await file.read(bytes, 0, end - begin, begin)
    return bytes.subarray(0, bytesRead)
  }
  const copc = await Copc.create(getter)
  const { header, info, eb } = copc

  // What copc-validator asks of a file.
  must(header.majorVersion === 1 && header.minorVersion === 4, 'not LAS 1.4')
  must(header.headerLength === 375, 'the header is not of 375 bytes')
  must([6, 7, 8].includes(header.pointDataRecordFormat), 'not point format 6, 7 or 8')
  must(copc.vlrs[0].userId === 'copc' && copc.vlrs[0].contentOffset === 429, 'the first record is not COPC\'s')
  must(header.pointCountByReturn.reduce((a, b) => a + b, 0) + zeros === header.pointCount,
    'points by return do not add up')
  const last = copc.vlrs.at(-1)
  must(last.contentOffset + last.contentLength === (await file.stat()).size, 'records do not end the file')

  const nodes = {}
  let pages = [info.rootHierarchyPage]
  let first = true
  while (pages.length) {
    const below = []
    for (const page of pages) {
      const subtree = await Copc.loadHierarchyPage(getter, page)
      // iTowns wants a page's root in the page.
      if (!first) must(subtree.nodes[page.key], `the page of ${page.key} lacks its root`)
      first = false
      Object.assign(nodes, subtree.nodes)
      for (const [key, page] of Object.entries(subtree.pages)) below.push({ ...page, key })
    }
    pages = below
  }

  const records = []
  const length = header.pointDataRecordLength
  for (const [name, node] of Object.entries(nodes)) {
    const key = Key.parse(name)
    if (key[0] > 0) {
      const parent = Key.toString([key[0] - 1, ...key.slice(1).map((c) => c >> 1)])
      must(nodes[parent], `${name} has no parent`)
    }
    if (node.pointCount === 0) continue
    const view = await Copc.loadPointDataView(getter, copc, node)
    const [x, y, z] = ['X', 'Y', 'Z'].map((axis) => view.getter(axis))
    const box = Bounds.stepTo(info.cube, key)
    for (let i = 0; i < view.pointCount; ++i) {
      const at = [x(i), y(i), z(i)]
      const inside = at.every((value, axis) => box[axis] <= value && value <= box[axis + 3])
      must(inside, `${name}: ${at} lies outside of ${box}`)
    }
    const buffer = Buffer.from(await Copc.loadPointDataBuffer(getter, header, node))
    must(buffer.length === node.pointCount * length, `${name} has ${buffer.length} bytes`)
    for (let i = 0; i < node.pointCount; ++i) records.push(buffer.subarray(i * length, (i + 1) * length))
  }
  records.sort(Buffer.compare)
  const hash = createHash('sha256')
  records.forEach((record) => hash.update(record))
  console.log(JSON.stringify({
    points: records.length,
    nodes: Object.keys(nodes).length,
    sha256: hash.digest('hex'),
    extra: (eb ?? []).map((field) => field.name),
    wkt: copc.wkt ?? null,
  }))
  await file.close()
}

for (let i = 2; i < process.argv.length; i += 2) {
  await read(process.argv[i], Number(process.argv[i + 1])).catch((error) => {
    throw new Error(process.argv[i], { cause: error })
  })
}
