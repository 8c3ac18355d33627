// Draws the report from its JSON. Everything that comes from the data is set as text, never as markup.
'use strict';
(() => {
const source = document.getElementById('data').textContent;
const report = JSON.parse(source);
const cutText = new Map(report.chain.map(c => [c.cut, c]));

// ---- numbers for people ------------------------------------------------------------------------------------

// SI unit -> what people read it in: [size below which, factor, unit], as everywhere that this diagnosis is shown.
const kScales = report.shown_units;
const scaleFor = (unit, magnitude) => {
  const choices = kScales[unit];
  if (!choices) return {factor: 1, unit: unit || ''};
  const [, factor, name] = choices.find(([below]) => below === null || Math.abs(magnitude) < below) || choices[choices.length - 1];
  return {factor, unit: name};
};
const digits = (v, n = 3) => {
  if (v === null || v === undefined || !isFinite(v)) return '–';
  if (v === 0) return '0';
  const a = Math.abs(v);
  if (a >= 1e5 || a < 1e-4) return v.toExponential(n - 1).replace('e+', 'e').replace('-', '−');
  const places = Math.max(0, n - 1 - Math.floor(Math.log10(a)));
  let text = v.toFixed(Math.min(places, 8));
  if (text.includes('.')) text = text.replace(/\.?0+$/, '');
  return text.replace('-', '−');
};
const withUnit = (number, unit) => number === '–' || !unit ? number : number + (unit.startsWith('°') ? '' : ' ') + unit;
const show = (v, unit, n = 3) => {
  if (v === null || v === undefined) return '–';
  const s = scaleFor(unit, v);
  return withUnit(digits(v * s.factor, n), s.unit);
};
const percent = v => {
  if (v === null || v === undefined) return '–';
  const p = Math.sign(v) * Math.round(Math.abs(100 * v));
  return (p >= 100 && v < 1 ? '>99' : p === 0 ? (v > 0 ? '<1' : '0') : String(p).replace('-', '−')) + ' %';
};
const range = ci => !ci || ci[0] === null || ci[1] === null ? '' : ci[0] < -1 ? `up to ${percent(ci[1])}` : `${percent(ci[0])} … ${percent(ci[1])}`;
const plain = name => name === 'no_gap' ? 'no gap' : name.replaceAll('_', ' ');
const capital = text => text.charAt(0).toUpperCase() + text.slice(1);
const place = where => !where || where === 'all' ? '' : where.replace(':', ' ');
const causeText = c => plain(c.effect) + (place(c.where) ? ` · ${place(c.where)}` : '');
// Written once for all, with the report.
const parametersText = c => Object.values(c.parameters).map(e => e.text.replaceAll('-', '−')).join(', ');
const largest = lists => {
  let most = 0;
  for (const list of lists) for (const v of list || []) if (v !== null && Math.abs(v) > most) most = Math.abs(v);
  return most;
};
const scaled = (list, factor) => (list || []).map(v => v === null ? null : v * factor);

// ---- elements ----------------------------------------------------------------------------------------------

const el = (tag, attributes = {}, ...children) => {
  const e = document.createElement(tag);
  for (const [k, v] of Object.entries(attributes)) {
    if (k === 'on') for (const [event, f] of Object.entries(v)) e.addEventListener(event, f);
    else if (v !== null && v !== undefined && v !== false) e.setAttribute(k, v === true ? '' : v);
  }
  for (const child of children.flat()) if (child !== null && child !== undefined) e.append(child);
  return e;
};
const main = document.getElementById('main');
const nav = el('div');
document.getElementById('nav').append(nav);

const tip = document.getElementById('tip');
const moveTip = event => {
  const x = event.clientX, y = event.clientY, w = tip.offsetWidth, h = tip.offsetHeight;
  tip.style.left = Math.max(4, Math.min(window.innerWidth - w - 8, x + 14)) + 'px';
  tip.style.top = (y + h + 24 > window.innerHeight ? y - h - 12 : y + 16) + 'px';
};
const showTip = (event, text) => { tip.textContent = text; tip.hidden = false; moveTip(event); };
const hideTip = () => { tip.hidden = true; };
// d3's selections: text on hover, and as a title for readers without a mouse.
const tipped = (selection, text) => selection
  .on('mouseenter', d => showTip(d3.event, text(d))).on('mousemove', () => moveTip(d3.event)).on('mouseleave', hideTip)
  .attr('aria-label', text).attr('role', 'img');

// Words in lines of at most `most` letters; a word that is longer stands alone.
const inLines = (text, most) => {
  const lines = [''];
  for (const word of text.split(/\s+/)) {
    const longer = (lines[lines.length - 1] + ' ' + word).trim();
    if (longer.length > most && lines[lines.length - 1]) lines.push(word); else lines[lines.length - 1] = longer;
  }
  return lines;
};
// No word leaves its figure: it is moved in, or shortened where there is no room; whole on hover.
const keepInside = svg => {
  const frame = svg.getBoundingClientRect();
  if (!frame.width) return;
  for (const text of svg.querySelectorAll('text')) {
    const whole = text.textContent;
    let box = text.getBoundingClientRect();
    while (box.width > frame.width && text.textContent.length > 4) {
      text.textContent = text.textContent.slice(0, -2) + '…';
      box = text.getBoundingClientRect();
    }
    const over = v => Math.max(0, v);
    const dx = over(frame.left - box.left) - over(box.right - frame.right), dy = over(frame.top - box.top) - over(box.bottom - frame.bottom);
    if (dx || dy) text.setAttribute('transform', `translate(${dx},${dy}) ${text.getAttribute('transform') || ''}`);
    if (text.textContent !== whole) text.append(el('title', {}, whole));
  }
};

// ---- figures as files --------------------------------------------------------------------------------------

const save = (address, name) => {
  const link = el('a', {href: address, download: name});
  document.body.append(link);
  link.click();
  link.remove();
};
const asData = (type, text) => `data:${type};charset=utf-8,${encodeURIComponent(text)}`;
const kLooks = ['fill', 'fill-opacity', 'stroke', 'stroke-width', 'stroke-dasharray', 'stroke-linejoin', 'opacity', 'display', 'font-size', 'font-family', 'font-weight', 'text-anchor', 'vector-effect'];
// With its looks in itself, title and legend above: for paper, so light whatever the screen is.
const standalone = (host, label) => {
  const svg = host.querySelector('svg'), [, , width, height] = svg.getAttribute('viewBox').split(' ').map(Number);
  const keys = host.closest('.card').querySelector('.legend') || host.closest('section').querySelector(':scope > .legend');
  const head = 26 + (keys ? keys.offsetHeight + 8 : 0), out = d3.create('svg').attr('xmlns', 'http://www.w3.org/2000/svg').attr('width', width).attr('height', height + head).attr('viewBox', `0 0 ${width} ${height + head}`);
  out.append('rect').attr('width', width).attr('height', height + head).attr('fill', '#fff');
  out.append('text').attr('x', 2).attr('y', 16).attr('style', 'font: 600 13px sans-serif').text(label);
  document.documentElement.classList.add('paper');
  const copied = from => {
    const copy = from.cloneNode(true), all = [copy, ...copy.querySelectorAll('*')];
    [from, ...from.querySelectorAll('*')].forEach((e, i) => {
      const looks = getComputedStyle(e);
      all[i].setAttribute('style', kLooks.map(k => `${k}:${looks.getPropertyValue(k)}`).join(';'));
      for (const {name, value} of [...all[i].attributes]) if (name === 'class' || (name !== 'style' && value.includes('var('))) all[i].removeAttribute(name);
    });
    return copy;
  };
  try {
    const main = copied(svg);
    [...svg.querySelectorAll('*')].map((e, i) => e.closest('.brush, .crosshair') ? main.querySelectorAll('*')[i] : null).forEach(e => e && e.remove());
    main.setAttribute('y', head);
    out.node().append(main);
    if (keys) {
      const at = keys.getBoundingClientRect(), most = Math.max(1, at.width / width);
      for (const span of keys.querySelectorAll('span')) {
        const box = span.getBoundingClientRect(), sample = copied(span.querySelector('svg')), x = (box.left - at.left) / most, y = 26 + box.top - at.top;
        sample.setAttribute('x', x);
        sample.setAttribute('y', y + 4);
        out.node().append(sample);
        out.append('text').attr('x', x + 33).attr('y', y + 15).attr('style', 'font: 12px sans-serif').attr('fill', '#444').text(span.textContent);
      }
    }
  } finally {
    document.documentElement.classList.remove('paper');
  }
  return {text: new XMLSerializer().serializeToString(out.node()), width, height: height + head};
};
const savePng = async (figure, name) => {
  const image = new Image(), finer = 3, canvas = el('canvas', {width: figure.width * finer, height: figure.height * finer});
  image.src = asData('image/svg+xml', figure.text);
  await image.decode();
  canvas.getContext('2d').drawImage(image, 0, 0, canvas.width, canvas.height);
  save(canvas.toDataURL(), name);
};
const csvText = rows => rows.map(row => row.map(v => {
  const text = v === null || v === undefined ? '' : String(v);
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}).join(',') + '\n').join('');
const fileButtons = (host, label, rows) => {
  const name = kind => `${[report.provenance.robot_name, label].join(' ').toLowerCase().replace(/[^a-z0-9]+/g, '_').slice(0, 80)}.${kind}`;
  const button = (kind, make) => el('button', {type: 'button', 'aria-label': `${label}: save as ${kind}`, on: {click: make}}, kind);
  return el('div', {class: 'files'}, button('PNG', () => savePng(standalone(host, label), name('png'))),
    button('SVG', () => save(asData('image/svg+xml', standalone(host, label).text), name('svg'))),
    button('CSV', () => save(asData('text/csv', csvText(rows())), name('csv'))));
};

const charts = [];
// A plot that is drawn again when its width changes: draw(svg, width) returns the height; rows() its numbers in SI
// units below a row of names, for the file beside it.
const chart = (card, label, draw, rows) => {
  const host = el('div', {class: 'plot'});
  card.append(host, fileButtons(host, label, rows));
  const paint = width => {
    host.replaceChildren();
    const w = Math.max(220, Math.floor(width || host.clientWidth || 700));
    const svg = d3.select(host).append('svg').attr('role', 'img').attr('aria-label', label).attr('width', w);
    const h = draw(svg, w);
    svg.attr('height', h).attr('viewBox', `0 0 ${w} ${h}`);
    keepInside(svg.node());
  };
  charts.push({host, paint});
  return paint;
};
// Columns of [name, unit, numbers] as rows.
const columnRows = (...columns) => {
  const kept = columns.filter(([, , list]) => list && list.length), length = Math.max(0, ...kept.map(([, , list]) => list.length));
  return [kept.map(([name, unit]) => unit ? `${name} [${unit}]` : name), ...Array.from({length}, (_, i) => kept.map(([, , list]) => list[i]))];
};

const problems = [];
const section = (id, title, short, caption, build) => {
  const s = el('section', {id}, el('h2', {}, title), el('p', {class: 'caption'}, caption));
  main.append(s);
  const before = charts.length;
  try {
    const built = build(s);
    if (built !== false) for (const c of charts.slice(before)) c.paint();
    // A title with nothing under it says nothing.
    if (built === false || !s.querySelector('svg *, td, li, pre, p:not(.caption)')) { s.remove(); charts.length = before; return; }
  } catch (error) {
    problems.push(`${id}: ${error.message}`);
    console.error(error);
    s.append(el('p', {class: 'problem'}, `This part could not be drawn (${error.message}); its numbers are in report.json.`));
  }
  nav.append(el('a', {href: '#' + id}, short));
};

// What the runs are compared with: the robot as learned from runs before, where it was.
const nominal = Object.values((report.closed || {}).channels || {}).some(c => c.as_filed != null) ? 'robot as learned' : 'nominal simulation';
const strokeSample = {
  measured: ['measured', 'line measured'], before: [nominal, 'line before'], 'before-solid': [nominal, 'line before solid'], after: [`simulation with ${report.accepted.length ? 'the cause' : 'the best model'}`, 'line after'],
};
const legend = (...names) => el('div', {class: 'legend'}, names.map(name => {
  const svg = d3.create('svg').attr('width', 26).attr('height', 12);
  let text;
  if (strokeSample[name]) {
    text = strokeSample[name][0];
    svg.append('line').attr('class', strokeSample[name][1]).attr('x1', 0).attr('x2', 26).attr('y1', 6).attr('y2', 6);
  } else if (name === 'floor') {
    text = 'noise floor';
    svg.append('rect').attr('class', 'floor-band').attr('width', 26).attr('height', 12);
  } else if (name === 'floor-line') {
    text = 'noise floor';
    svg.append('line').attr('class', 'floor-line').attr('x1', 0).attr('x2', 26).attr('y1', 6).attr('y2', 6);
  } else if (name === 'band') {
    text = '95 % band';
    svg.append('rect').attr('class', 'before-band').attr('width', 26).attr('height', 12);
  } else {
    const fills = {'bar-before': [`before: ${nominal}`, 'fill-before'], 'bar-after': [`after: with ${report.accepted.length ? 'the cause' : 'the best model'}`, 'fill-after'],
                   'bar-ceiling': ['refit of all file numbers', 'fill-ceiling']};
    text = fills[name][0];
    svg.attr('width', 12).append('rect').attr('class', fills[name][1]).attr('width', 12).attr('height', 12).attr('rx', 2);
  }
  return el('span', {}, svg.node(), text);
}));

const axes = (g, x, y, w, h, xLabel, yLabel, {xTicks, yTicks = 4, format} = {}) => {
  const ticksX = xTicks || Math.max(3, Math.floor(w / 90));
  g.append('g').attr('class', 'gridlines').call(d3.axisLeft(y).ticks(yTicks).tickSize(-w).tickFormat(''));
  g.append('g').attr('class', 'axis').attr('transform', `translate(0,${h})`).call(d3.axisBottom(x).ticks(ticksX, format).tickSizeOuter(0));
  g.append('g').attr('class', 'axis').call(d3.axisLeft(y).ticks(yTicks, format).tickSizeOuter(0).tickSize(0).tickPadding(6)).call(a => a.select('.domain').remove());
  if (xLabel) g.append('text').attr('class', 'axis-label').attr('x', w).attr('y', h + 32).attr('text-anchor', 'end').text(xLabel);
  if (yLabel) g.append('text').attr('class', 'axis-label').attr('x', 0).attr('y', -8).attr('text-anchor', 'start').text(yLabel);
};
const padded = (low, high, by = 0.06) => {
  if (!(high > low)) { const c = isFinite(low) ? low : 0, r = Math.abs(c) * 0.1 || 1; return [c - r, c + r]; }
  return [low - by * (high - low), high + by * (high - low)];
};
const path = (x, y) => d3.line().defined(d => d[0] !== null && d[1] !== null && isFinite(d[0]) && isFinite(d[1])).x(d => x(d[0])).y(d => y(d[1]));
const zip = (a, b) => a.map((v, i) => [v, b[i] === undefined ? null : b[i]]);
const clip = (svg, w, h) => {
  clip.count = (clip.count || 0) + 1;
  const id = `clip${clip.count}`;
  svg.append('clipPath').attr('id', id).append('rect').attr('y', -2).attr('width', w).attr('height', h + 4);
  return `url(#${id})`;
};
const heat = sigma => sigma > 0 ? Math.min(0.8, 0.16 + 0.64 * Math.log2(1 + sigma) / Math.log2(31)) : 0;
const hatch = (svg, id, colour) => {
  const p = svg.append('defs').append('pattern').attr('id', id).attr('width', 6).attr('height', 6)
    .attr('patternUnits', 'userSpaceOnUse').attr('patternTransform', 'rotate(45)');
  p.append('rect').attr('width', 2.2).attr('height', 6).style('fill', `var(${colour})`);
};
const table = (head, rows) => el('div', {class: 'scroll'}, el('table', {},
  el('thead', {}, el('tr', {}, head.map(([text, kind]) => el('th', {class: kind}, text)))),
  el('tbody', {}, rows.map(({cells, kind}) => el('tr', {class: kind}, cells.map((c, i) => el('td', {class: head[i][1]}, c)))))));
const more = (title, ...content) => el('details', {}, el('summary', {}, title), content);
const copyButton = text => {
  const button = el('button', {type: 'button', on: {click: async () => {
    try {
      await navigator.clipboard.writeText(text);
    } catch (e) {
      const area = el('textarea', {}, text);
      document.body.append(area);
      area.select();
      document.execCommand('copy');
      area.remove();
    }
    button.textContent = 'Copied';
    setTimeout(() => { button.textContent = 'Copy'; }, 1500);
  }}}, 'Copy');
  return button;
};

// ---- the first screen --------------------------------------------------------------------------------------

const kVerdicts = {no_gap: 'No gap', attributed: 'Cause found', ambiguous_group: 'Several causes fit alike', unexplained: 'Cause not in the library',
                   insufficient_data: 'Not enough data'};
const first = report.location.filter(l => l.first);
const measuredCuts = report.location.filter(l => l.measured);
const strongest = report.location.filter(l => l.excess).sort((a, b) => b.excess_sigma - a.excess_sigma);
const title = cut => cutText.get(cut).title;

const facts = () => {
  const badge = document.getElementById('verdict');
  badge.textContent = kVerdicts[report.verdict];
  badge.classList.add(report.verdict);
  if (report.sentence.length > 240) document.querySelector('h1').classList.add('long');
  const p = report.provenance;
  document.getElementById('kicker').textContent = [
    p.robot_name || 'robot', `${p.runs.length} run${p.runs.length === 1 ? '' : 's'}`,
    `${digits(d3.sum(p.runs, r => r.duration_s), 3)} s measured`].join('  ·  ');
  const host = document.getElementById('facts');
  const fact = (key, value, small, extra) => host.append(el('div', {class: 'fact'}, el('div', {class: 'k'}, key), el('div', {class: 'v'}, capital(value)), extra || null, el('div', {class: 's'}, small)));

  if (first.length) {
    const places = [...new Set(first.map(l => place(l.where)).filter(Boolean))];
    const worst = d3.max(first, l => l.excess_sigma);
    fact('Where', `${capital(title(first[0].cut))} (${first[0].cut})`, [places.length && places.length <= 3 ? places.join(', ') : places.length ? `${places.length} places` : '', `${digits(worst, 2)} times the noise floor`].filter(Boolean).join(' · '));
  } else if (report.verdict === 'no_gap') {
    fact('Where', 'Nowhere', `all ${new Set(measuredCuts.map(l => l.cut)).size} places measured are at their noise floor`);
  } else if (strongest.length) {
    fact('Where', `${capital(title(strongest[0].cut))} (${strongest[0].cut})`, `${digits(strongest[0].excess_sigma, 2)} times the noise floor`);
  } else {
    const judged = new Set(measuredCuts.map(l => l.cut)).size;
    fact('Where', 'Not settled', judged ? `${judged} of ${report.chain.length} places could be judged; none exceeds its floor significantly` : 'no place in the chain could be judged');
  }

  const causes = report.accepted;
  const probability = name => (report.causes.find(c => c.effect === name) || {p: 0}).p;
  if (report.verdict === 'ambiguous_group') {
    const group = report.causes.find(c => c.group > 0);
    const members = group ? report.causes.filter(c => c.group === group.group) : causes;
    fact('Cause', members.map(causeText).join(' or '), `together ${percent(d3.sum(members, c => c.p))} likely; these runs cannot tell them apart`);
  } else if (report.verdict === 'unexplained') {
    fact('Cause', 'Unknown', `${percent(probability('unknown'))} likely that it is none of the library`);
  } else if (causes.length) {
    fact('Cause', causes.map(causeText).join(' and '), [causes.length === 1 ? percent(causes[0].p) + ' likely' : causes.map(c => percent(c.p)).join(' and ') + ' likely',
      ...causes.map(parametersText)].filter(Boolean).join(' · '));
  } else if (report.verdict === 'no_gap') {
    fact('Cause', 'None needed', `${percent(probability('no_gap'))} likely that there is no gap`);
  } else {
    fact('Cause', 'Not judged', 'these data do not allow it');
  }

  const pooled = report.closed.pooled;
  if (pooled && pooled.value !== null) {
    const meter = el('div', {class: 'meter'}, el('i', {style: `width:${Math.max(0, Math.min(100, 100 * pooled.value))}%`}));
    fact('Gap closed', percent(pooled.value), [range(pooled.ci), report.accepted.length ? `on held-out ${report.provenance.held_out_by}` : 'by the best model of the library'].filter(Boolean).join(' · '), meter);
  } else {
    fact('Gap closed', '–', report.verdict === 'no_gap' ? 'nothing to close' : 'no cause to add');
  }
  const next = report.next_experiment;
  if (next.family) fact('Next', plain(next.family), next.separation_sigma ? `tells the rivals apart by ${digits(next.separation_sigma, 2)} σ` : 'see below');
  else if (report.verdict === 'attributed') fact('Next', 'Apply the cause', 'no further experiment is needed; the command is below');
  else if (report.verdict === 'no_gap') fact('Next', 'Nothing', 'no further experiment is needed');
  else fact('Next', 'Look closer', 'no experiment of the menu would settle it');
};

// ---- the chain ---------------------------------------------------------------------------------------------

const chain = s => {
  const card = el('div', {class: 'card'});
  s.append(card);
  const cuts = report.chain.map(c => {
    const rows = report.location.filter(l => l.cut === c.cut);
    const told = rows.filter(l => l.measured);
    return {...c, rows, told, excess: told.some(l => l.excess), first: rows.some(l => l.first), worst: d3.max(told, l => l.excess_sigma) || 0};
  });
  const rowTip = l => [`${l.cut} ${title(l.cut)}: ${[place(l.where), l.quantity].filter(Boolean).join(', ')}`,
    !l.measured ? 'not covered by these logs' : `residual ${show(l.rms, l.unit)} rms, floor ${show(l.floor, l.unit)}, materiality ${show(l.delta, l.unit)}`,
    l.measured ? `excess ${digits(l.excess_sigma, 2)} σ, p = ${digits(l.p_value, 2)}${l.excess ? '' : ' (no gap here)'}` : '', l.note].filter(Boolean).join('\n');
  chart(card, 'Chain from command to tip, coloured by excess over the noise floor', (svg, width) => {
    hatch(svg, 'hatch-none', '--line');
    const columns = width < 560 ? 2 : width < 860 ? 4 : 7, gap = 20, w = (width - 2 - gap * (columns - 1)) / columns, boxHeight = 118;
    const size = 19, per = Math.max(1, Math.floor((w + 3) / (size + 3)));
    // Marks of each cut: one row of squares a quantity.
    for (const c of cuts) {
      c.groups = d3.nest().key(l => l.quantity).entries(c.rows).map(g => ({words: inLines(g.key, Math.max(8, Math.floor(w / 6.2))), rows: g.values, lines: Math.ceil(g.values.length / per)}));
      c.height = d3.sum(c.groups, g => 5 + 13 * g.words.length + g.lines * (size + 3) + 4);
    }
    let top = cuts.some(c => c.first) ? 26 : 4;
    for (let begin = 0; begin < cuts.length; begin += columns) {
      const line = cuts.slice(begin, begin + columns);
      line.forEach((c, i) => {
        const g = svg.append('g').attr('transform', `translate(${1 + i * (w + gap)},${top})`);
        const told = c.told.length > 0;
        const box = g.append('g');
        box.append('rect').attr('class', 'box').attr('width', w).attr('height', boxHeight).attr('rx', 9);
        if (!told) box.append('rect').attr('width', w).attr('height', boxHeight).attr('rx', 9).attr('fill', 'url(#hatch-none)').attr('opacity', .8);
        else if (c.excess) box.append('rect').attr('class', 'heat').attr('width', w).attr('height', boxHeight).attr('rx', 9).attr('opacity', heat(c.worst));
        if (c.first) {
          box.append('rect').attr('class', 'box first').attr('width', w).attr('height', boxHeight).attr('rx', 9).style('fill', 'none');
          g.append('text').attr('class', 'bold').attr('x', w / 2).attr('y', -9).attr('text-anchor', 'middle').style('fill', 'var(--bad)').text('▼ the gap starts here');
        }
        g.append('text').attr('class', 'tiny').attr('x', 10).attr('y', 19).text(c.cut);
        g.append('text').attr('class', 'bold').attr('x', 10).attr('y', 37).style('font-size', '13.5px').text(capital(c.title));
        g.append('text').attr('class', 'tiny').attr('x', 10).attr('y', 54).style('opacity', .82).text(c.from);
        g.append('text').attr('class', 'tiny').attr('x', 10).attr('y', 68).style('opacity', .82).text('→ ' + c.to);
        g.append('text').attr('class', 'bold').attr('x', 10).attr('y', 101).style('font-size', c.excess ? '22px' : '13px')
          .style('fill', !told ? 'var(--soft)' : c.excess ? null : 'var(--good)')
          .text(!told ? (c.rows.length ? 'not covered' : 'not measured') : c.excess ? `${digits(c.worst, 2)} σ` : '✓ at the floor');
        if (i + 1 < line.length) {
          g.append('path').attr('class', 'arrow').attr('d', `M${w + 4},${boxHeight / 2}h${gap - 11}`);
          g.append('path').attr('class', 'arrow-head').attr('d', `M${w + gap - 8},${boxHeight / 2 - 4}l6,4l-6,4z`);
        }
        tipped(box, () => [`${c.cut} ${c.title}: ${c.from} → ${c.to}`, ...c.rows.filter(l => l.note).slice(0, 3).map(l => l.note), told ? '' : 'These logs do not show it.'].filter(Boolean).join('\n'));
        let y = boxHeight + 16;
        for (const group of c.groups) {
          group.words.forEach((line, k) => g.append('text').attr('class', 'tiny soft').attr('x', 1).attr('y', y + 13 * k).text(line));
          y += 13 * group.words.length - 8;
          group.rows.forEach((l, k) => {
            const all = !l.where || l.where === 'all', section = l.where.startsWith('section');
            const m = g.append('g').attr('transform', `translate(${(k % per) * (size + 3)},${y + Math.floor(k / per) * (size + 3)})`);
            const shape = () => m.append('rect').attr('width', all ? 30 : size).attr('height', size).attr('rx', section ? size / 2 : 4);
            shape().attr('class', 'box' + (l.first ? ' first' : '')).style('stroke-width', l.first ? 2 : 1);
            if (!l.measured) shape().attr('fill', 'url(#hatch-none)');
            else if (l.excess) shape().attr('class', 'heat').attr('opacity', heat(l.excess_sigma));
            m.append('text').attr('class', 'tiny').attr('x', (all ? 30 : size) / 2).attr('y', size / 2 + 4).attr('text-anchor', 'middle').text(all ? 'all' : l.where.replace(/^.*:/, ''));
            tipped(m, () => rowTip(l));
          });
          y += group.lines * (size + 3) + 4 + 13;
        }
      });
      top += boxHeight + (d3.max(line, c => c.height) || 0) + 34;
    }
    return top - 14;
  }, () => [['cut', 'place', 'quantity', 'unit', 'measured', 'residual rms', 'floor', 'what matters', 'excess [sigma]', 'p value', 'excess', 'first', 'note'],
    ...report.location.map(l => [l.cut, l.where, l.quantity, l.unit, l.measured, l.rms, l.floor, l.delta, l.excess_sigma, l.p_value, l.excess, l.first, l.note])]);
  card.append(el('p', {class: 'note'}, 'Squares are tendons, circles sections, numbered from the first. σ: how many times its own noise floor the residual exceeds it. Only excess beyond the materiality δ is coloured.'),
    more('All residuals as a table', table(
      [['cut', 'c'], ['place', 'c'], ['quantity', 'c'], ['residual rms', 'n'], ['floor', 'n'], ['δ', 'n'], ['excess', 'n'], ['p', 'n'], ['', 'c']],
      report.location.map(l => ({kind: l.first ? 'first' : l.excess ? '' : 'muted', cells: [`${l.cut} ${title(l.cut)}`, place(l.where) || 'all', l.quantity,
        l.measured ? show(l.rms, l.unit) : '–', l.measured ? show(l.floor, l.unit) : '–', show(l.delta, l.unit), l.measured ? `${digits(l.excess_sigma, 2)} σ` : '–', l.measured ? digits(l.p_value, 2) : '–',
        [l.first ? 'here the gap starts' : l.excess ? 'excess' : '', l.note].filter(Boolean).join('; ')]})))));
};

// ---- causes ------------------------------------------------------------------------------------------------

const causes = s => {
  const card = el('div', {class: 'card'});
  s.append(card);
  const accepted = new Set(report.accepted.map(c => c.effect + ' ' + c.where));
  // Members of a group stand together, at the place of the likeliest.
  const ordered = [];
  for (const c of report.causes) {
    if (ordered.includes(c)) continue;
    ordered.push(c, ...report.causes.filter(o => o !== c && c.group > 0 && o.group === c.group));
  }
  const special = c => c.effect === 'no_gap' || c.effect === 'unknown';
  let all = false;
  const few = ordered.filter((c, i) => special(c) || i < 8 || accepted.has(c.effect + ' ' + c.where));
  const paint = chart(card, 'Probability of each cause', (svg, width) => {
    hatch(svg, 'hatch-unknown', '--unknown');
    const rows = all ? ordered : few, height = 38, left = Math.min(250, width * 0.32), right = Math.min(330, width * 0.3), w = width - left - right - 74;
    const x = d3.scaleLinear([0, 1], [0, w]);
    const g = svg.append('g').attr('transform', `translate(${left},4)`);
    rows.forEach((c, i) => {
      const row = g.append('g').attr('transform', `translate(0,${i * height})`);
      const inModel = accepted.has(c.effect + ' ' + c.where);
      const kind = special(c) ? c.effect : report.verdict === 'ambiguous_group' && c.group > 0 ? 'ambiguous' : inModel ? 'accepted' : 'cause';
      row.append('text').attr('x', -14).attr('y', c.where && c.where !== 'all' ? 15 : 21).attr('text-anchor', 'end').attr('class', inModel ? 'bold' : '').style('font-size', '13px')
        .text(c.effect === 'unknown' ? 'unknown, not in the library' : plain(c.effect));
      if (place(c.where)) row.append('text').attr('x', -14).attr('y', 30).attr('text-anchor', 'end').attr('class', 'tiny soft').text(place(c.where));
      row.append('rect').attr('class', 'track').attr('y', 8).attr('width', w).attr('height', 18).attr('rx', 3);
      row.append('rect').attr('class', `bar ${kind}`).attr('y', 8).attr('width', Math.max(1.5, x(c.p || 0))).attr('height', 18).attr('rx', 3);
      row.append('text').attr('class', 'bold').attr('x', w + 10).attr('y', 21).style('font-size', '13px').text(percent(c.p));
      row.append('text').attr('class', 'tiny soft').attr('x', w + 74).attr('y', 21)
        .text([parametersText(c), c.bound_hit ? 'at a bound!' : ''].filter(Boolean).join(' '))
        .each(function () { while (this.getComputedTextLength() > right && this.textContent.length > 4) this.textContent = this.textContent.slice(0, -3) + '…'; });
      row.append('rect').attr('x', -left).attr('width', width).attr('height', height).attr('fill', 'transparent');
      tipped(row, () => [causeText(c) + ': ' + percent(c.p), c.about, parametersText(c), special(c) || !c.held_out_gain ? '' : `removes ${percent(c.held_out_gain)} of the excess on held-out runs`,
        c.bound_hit ? 'The fit ended at a physical bound: do not trust the value.' : '', c.note].filter(Boolean).join('\n'));
    });
    let begin = 0;
    while (begin < rows.length) {
      let end = begin;
      while (end + 1 < rows.length && rows[begin].group > 0 && rows[end + 1].group === rows[begin].group) ++end;
      if (end > begin) g.append('path').attr('class', 'bracket').attr('d', `M-4,${begin * height + 6}h-5v${(end - begin) * height + 24}h5`);
      begin = end + 1;
    }
    return rows.length * height + 8;
  }, () => [['effect', 'where', 'probability', 'group', 'parameter', 'value', 'low', 'high', 'unit', 'at a bound', 'removed on held-out runs'],
    ...ordered.flatMap(c => (Object.entries(c.parameters).length ? Object.entries(c.parameters) : [['', {ci: []}]]).map(([name, e]) =>
      [c.effect, c.where, c.p, c.group, name, e.value, e.ci[0], e.ci[1], e.unit, c.bound_hit, c.held_out_gain]))]);
  if (ordered.length > few.length) {
    const button = el('button', {type: 'button', on: {click: () => { all = !all; paint(); button.textContent = label(); }}});
    const label = () => all ? 'Show the likeliest only' : `Show all ${ordered.length} hypotheses`;
    button.textContent = label();
    card.append(el('div', {class: 'controls', style: 'margin:8px 0 0'}, button));
  }
  const groups = d3.nest().key(c => c.group).entries(report.causes.filter(c => c.group > 0)).filter(g => g.values.length > 1);
  for (const g of groups) card.append(el('p', {class: 'note'}, `Bracketed: ${g.values.map(causeText).join(', ')} have the same signature in these runs. Together ${percent(d3.sum(g.values, c => c.p))}.`));
  const about = report.accepted.map(a => report.causes.find(c => c.effect === a.effect && c.where === a.where) || a).filter(c => c.about);
  for (const c of about) card.append(el('p', {class: 'note'}, `${causeText(c)}: ${c.about} (tendril gap explain ${c.effect})`));
  for (const c of report.accepted.filter(c => c.bound_hit)) card.append(el('p', {class: 'note problem'}, `The fit of ${causeText(c)} ended at a physical bound: its value is not to be trusted.`));
};

// ---- how far it shrinks ------------------------------------------------------------------------------------

const closing = s => {
  const channels = Object.values(report.closed.channels), pooled = report.closed.pooled, ceiling = report.closed.ceiling;
  if (!channels.length && !pooled) return false;
  if (pooled && pooled.value !== null) {
    const card = el('div', {class: 'card'});
    s.append(card);
    chart(card, 'Share of the gap that closes', (svg, width) => {
      const left = 122, right = 20, w = width - left - right, grew = pooled.value < 0, x = d3.scaleLinear([0, Math.max(1, 1 - pooled.value)], [0, w]), bar = 24, step = 36;
      const g = svg.append('g').attr('transform', `translate(${left},6)`);
      const rows = [['before', `gap of the ${nominal}`, 0, 1, 'fill-before']];
      rows.push(grew ? ['grew', 'the gap grew', 1, 1 - pooled.value, 'fill-before'] : ['closed', `closed by ${report.accepted.map(causeText).join(' and ') || 'the best model of the library'}`, 1 - pooled.value, 1, 'fill-after']);
      rows.push(['left', 'left over', 0, Math.max(0, 1 - pooled.value), 'fill-before']);
      rows.forEach(([key, text, from, to, kind], i) => {
        const row = g.append('g').attr('transform', `translate(0,${i * step})`);
        row.append('text').attr('class', 'soft').attr('x', -12).attr('y', 16).attr('text-anchor', 'end').text(key === 'before' ? 'gap before' : key === 'closed' || key === 'grew' ? key : 'gap after');
        row.append('rect').attr('class', 'track').attr('width', w).attr('height', bar).attr('rx', 3);
        row.append('rect').attr('class', kind).attr('x', x(Math.min(from, to))).attr('width', Math.max(1.5, Math.abs(x(to) - x(from)))).attr('height', bar).attr('rx', 3);
        const label = key === 'before' ? '100 %' : key === 'closed' ? `${percent(pooled.value)}  ${text}` : key === 'grew' ? `${text} by ${percent(-pooled.value)}` : percent(1 - pooled.value);
        const inside = x(Math.max(from, to)) - x(Math.min(from, to)) > 260 || key === 'before';
        row.append('text').attr('class', 'bold').attr('y', 16).attr('x', inside ? x(Math.min(from, to)) + 10 : key === 'closed' || key === 'grew' ? x(from) - 8 : x(to) + 8)
          .attr('text-anchor', !inside && (key === 'closed' || key === 'grew') ? 'end' : 'start').style('fill', inside ? 'var(--card)' : 'var(--ink)').text(label);
        if (key === 'left' && pooled.ci && pooled.ci[0] !== null) {
          const a = x(Math.max(0, 1 - pooled.ci[1])), b = Math.min(w, x(Math.max(0, 1 - pooled.ci[0])));
          row.append('path').attr('class', 'whisker').attr('fill', 'none').attr('d', `M${a},${bar + 2}v6M${a},${bar + 5}H${b}M${b},${bar + 2}v6`);
          row.append('text').attr('class', 'tiny soft').attr('x', b + 6).attr('y', bar + 10).text('95 %');
        }
      });
      let height = rows.length * step + 12;
      if (ceiling && ceiling.value !== null) {
        const at = x(Math.max(0, 1 - ceiling.value));
        g.append('path').attr('d', `M${at},${step * 2 - 8}V${step * 3 + 2}`).attr('stroke', 'var(--ceiling)').attr('stroke-width', 2.5);
        g.append('text').attr('class', 'tiny').attr('x', at).attr('y', step * 3 + 16).attr('text-anchor', at > 40 ? 'middle' : 'start').style('fill', 'var(--ceiling)')
          .text(`refit of all file numbers: ${percent(ceiling.value)} closed`);
        height += 14;
      }
      return height;
    }, () => [['share', 'value', 'low', 'high'], ['closed', pooled.value, ...(pooled.ci || [])],
      ...(ceiling && ceiling.value !== null ? [['closed by a refit of all file numbers', ceiling.value, ...(ceiling.ci || [])]] : [])]);
    card.append(el('p', {class: 'note'}, `Mean square of the residual over the channels that have a gap: 0 % is the noise floor, 100 % the ${nominal}.`));
    if (report.order_effects.length) {
      card.append(el('h3', {}, 'Each cause by itself, and after the other'));
      chart(card, 'Closed by each cause in both orders', (svg, width) => {
        const left = Math.min(380, width * .45), w = width - left - 70, x = d3.scaleLinear([0, Math.max(1, d3.max(report.order_effects, o => o.value) || 1)], [0, w]).clamp(true), step = 26;
        const g = svg.append('g').attr('transform', `translate(${left},2)`);
        report.order_effects.forEach((o, i) => {
          const row = g.append('g').attr('transform', `translate(0,${i * step})`);
          row.append('text').attr('x', -12).attr('y', 14).attr('text-anchor', 'end').text(plain(o.name));
          row.append('rect').attr('class', 'track').attr('y', 2).attr('width', w).attr('height', 16).attr('rx', 3);
          row.append('rect').attr('class', 'fill-after').attr('y', 2).attr('width', Math.max(1.5, x(o.value || 0))).attr('height', 16).attr('rx', 3);
          row.append('text').attr('class', 'bold').attr('x', w + 10).attr('y', 14).text(percent(o.value));
        });
        return report.order_effects.length * step + 4;
      }, () => columnRows(['cause', '', report.order_effects.map(o => o.name)], ['closed', '', report.order_effects.map(o => o.value)]));
    }
  }
  if (!channels.length) return;
  const withCeiling = channels.some(c => c.ceiling !== null && c.ceiling !== undefined);
  const withAfter = report.accepted.length > 0 || (pooled !== null && pooled.value !== null);
  const card = el('div', {class: 'card'}, el('div', {class: 'plot-title'}, 'Residual of each channel on held-out runs, rms, and how much of its gap closes'),
    legend('bar-before', ...(withAfter ? ['bar-after'] : []), ...(withCeiling ? ['bar-ceiling'] : []), 'floor-line'));
  s.append(card);
  chart(card, 'Residual of each channel before and after, with the noise floor', (svg, width) => {
    hatch(svg, 'hatch-floor', '--floor');
    const panels = d3.nest().key(c => c.unit).entries(channels).map(p => ({unit: p.key, rows: p.values}));
    const widths = panels.map(p => 54 + p.rows.length * 74);
    let top = 0, lineWidth = 0;
    const lines = [[]];
    panels.forEach((p, i) => {
      if (lineWidth > 0 && lineWidth + widths[i] > width) { lines.push([]); lineWidth = 0; }
      lines[lines.length - 1].push({...p, natural: widths[i]});
      lineWidth += widths[i] + 16;
    });
    for (const line of lines) {
      const stretch = Math.min(1.35, (width - 16 * (line.length - 1)) / d3.sum(line, p => p.natural));
      let left = 0, mostLines = 1;
      for (const p of line) {
        const s0 = scaleFor(p.unit, largest([p.rows.map(c => c.before), p.rows.map(c => c.after)]));
        const full = p.natural * stretch, h = 190, w = full - 54;
        const y = d3.scaleLinear(padded(0, d3.max(p.rows, c => Math.max(c.before || 0, c.after || 0, c.ceiling || 0, c.floor || 0)) * s0.factor, .1), [h, 0]).nice(4);
        y.domain([0, y.domain()[1]]);
        const x = d3.scaleBand(p.rows.map((c, i) => i), [0, w]).padding(.22);
        const g = svg.append('g').attr('transform', `translate(${left + 46},${top + 26})`);
        g.append('g').attr('class', 'gridlines').call(d3.axisLeft(y).ticks(4).tickSize(-w).tickFormat(''));
        g.append('g').attr('class', 'axis').call(d3.axisLeft(y).ticks(4).tickSize(0).tickPadding(6)).call(a => a.select('.domain').remove());
        g.append('text').attr('class', 'axis-label').attr('x', 0).attr('y', -10).text(s0.unit || 'no unit');
        p.rows.forEach((c, i) => {
          const kinds = [['before', c.before], ...(withAfter ? [['after', c.after]] : []), ...(withCeiling ? [['ceiling', c.ceiling]] : [])];
          const bars = d3.scaleBand(kinds.map(k => k[0]), [0, x.bandwidth()]).padding(.12);
          const group = g.append('g').attr('transform', `translate(${x(i)},0)`);
          for (const [kind, value] of kinds) {
            if (value === null || value === undefined) continue;
            group.append('rect').attr('class', 'fill-' + kind).attr('x', bars(kind)).attr('width', bars.bandwidth()).attr('y', y(value * s0.factor)).attr('height', Math.max(0, h - y(value * s0.factor))).attr('rx', 1.5);
          }
          if (c.floor !== null) group.append('line').attr('class', 'floor-line').style('stroke', 'var(--ink)').attr('x1', -3).attr('x2', x.bandwidth() + 3).attr('y1', y(c.floor * s0.factor)).attr('y2', y(c.floor * s0.factor));
          const textLines = inLines(c.channel, Math.max(9, x.step() / 6.2));
          mostLines = Math.max(mostLines, Math.min(3, textLines.filter(Boolean).length));
          textLines.filter(Boolean).slice(0, 3).forEach((t, k) => group.append('text').attr('class', 'tiny soft').attr('x', x.bandwidth() / 2).attr('y', h + 16 + 13 * k).attr('text-anchor', 'middle').text(t));
          if (c.value !== null && withAfter) group.append('text').attr('class', 'tiny bold').attr('x', x.bandwidth() / 2).attr('y', y(Math.max(c.before || 0, c.after || 0, c.ceiling || 0) * s0.factor) - 5).attr('text-anchor', 'middle').text(percent(c.value));
          group.append('rect').attr('x', -6).attr('width', x.bandwidth() + 12).attr('height', h).attr('fill', 'transparent');
          tipped(group, () => [`${c.channel} (${c.cut} ${title(c.cut)})`, `before ${show(c.before, c.unit)}, after ${show(c.after, c.unit)}, floor ${show(c.floor, c.unit)}`,
            withCeiling ? `refit of all file numbers ${show(c.ceiling, c.unit)}` : '', c.value === null ? 'no significant gap here: not counted' : `closed ${percent(c.value)} (${range(c.ci)})`].filter(Boolean).join('\n'));
        });
        left += full + 16;
      }
      top += 26 + 190 + 20 + 13 * mostLines;
    }
    return top;
  }, () => [['channel', 'cut', 'unit', 'before, rms', 'after, rms', 'refit of all file numbers, rms', 'floor, rms', 'closed', 'low', 'high'],
    ...channels.map(c => [c.channel, c.cut, c.unit, c.before, c.after, c.ceiling, c.floor, c.value, ...(c.ci || [])])]);
  card.append(more('These figures as a table', table([['channel', 'c'], ['cut', 'c'], ['before', 'n'], ['after', 'n'], ['refit of all', 'n'], ['floor', 'n'], ['closed', 'n'], ['95 %', 'n']],
    channels.map(c => ({cells: [c.channel, c.cut, show(c.before, c.unit), show(c.after, c.unit), show(c.ceiling, c.unit), show(c.floor, c.unit), percent(c.value), range(c.ci)]})))));
};

// ---- held-out runs ----------------------------------------------------------------------------------------

const overlays = s => {
  const shown = report.overlays.filter(o => o.time_s.length > 1 && o.measured.some(v => v !== null));
  if (!shown.length) return false;
  const hasAfter = shown.some(o => o.after.length);
  const misfit = o => {
    const d = o.measured.map((v, i) => v === null || o.before[i] === null || o.before[i] === undefined ? 0 : v - o.before[i]);
    return Math.sqrt(d3.mean(d, v => v * v) || 0) / (o.floor || 1);
  };
  let current = shown[d3.scan(shown, (a, b) => misfit(b) - misfit(a))];
  const runs = [...new Set(shown.map(o => o.run))];
  const runSelect = el('select', {'aria-label': 'run'}, runs.map(r => el('option', {value: r, selected: r === current.run}, r)));
  const channelSelect = el('select', {'aria-label': 'channel'});
  const fillChannels = () => {
    channelSelect.replaceChildren(...shown.filter(o => o.run === runSelect.value).map(o => el('option', {value: shown.indexOf(o), selected: o === current}, `${o.channel}  (${o.cut} ${title(o.cut)})`)));
    if (current.run !== runSelect.value) current = shown.find(o => o.run === runSelect.value && o.channel === current.channel) || shown.find(o => o.run === runSelect.value);
    channelSelect.value = shown.indexOf(current);
  };
  let domain = null;
  const reset = el('button', {type: 'button', hidden: true, on: {click: () => { domain = null; paint(); }}}, 'Show all of it');
  const card = el('div', {class: 'card'},
    el('div', {class: 'controls'}, el('label', {}, 'run ', runSelect), el('label', {}, 'channel ', channelSelect), el('span', {}, 'drag across to zoom, double-click to go back'), reset),
    legend('measured', 'before', ...(hasAfter ? ['after'] : []), 'floor'));
  s.append(card);
  const paint = chart(card, 'Measured and simulated over time', (svg, width) => {
    const o = current, left = 56, right = 10, w = width - left - right, h = 250, h2 = 130, gap = 52, top = 22;
    const scale = scaleFor(o.unit, largest([o.measured, o.before, o.after]));
    const f = scale.factor, measured = scaled(o.measured, f), before = scaled(o.before, f), after = scaled(o.after, f), floor = (o.floor || 0) * f, t = o.time_s;
    const x = d3.scaleLinear(domain || d3.extent(t), [0, w]);
    const [t0, t1] = x.domain();
    const inside = list => list.filter((v, i) => v !== null && t[i] >= t0 && t[i] <= t1);
    const all = [...inside(measured), ...inside(before), ...inside(after)];
    const y = d3.scaleLinear(padded(d3.min(all) - floor, d3.max(all) + floor), [h, 0]).nice(5);
    const g = svg.append('g').attr('transform', `translate(${left},${top})`);
    const mask = clip(svg, w, h);
    axes(g, x, y, w, h, '', `${o.channel}${scale.unit ? ` [${scale.unit}]` : ''}`, {yTicks: 5});
    const plot = g.append('g').attr('clip-path', mask);
    plot.append('path').attr('class', 'floor-band').attr('d', d3.area().defined(d => d[1] !== null).x(d => x(d[0])).y0(d => y(d[1] - floor)).y1(d => y(d[1] + floor))(zip(t, measured)));
    plot.append('path').attr('class', 'line measured').attr('d', path(x, y)(zip(t, measured)));
    plot.append('path').attr('class', 'line before').attr('d', path(x, y)(zip(t, before)));
    if (after.length) plot.append('path').attr('class', 'line after').attr('d', path(x, y)(zip(t, after)));
    // What is missed, on its own scale.
    const miss = list => list.map((v, i) => v === null || measured[i] === null || measured[i] === undefined ? null : measured[i] - v);
    const missBefore = miss(before), missAfter = miss(after);
    const most = Math.max(largest([inside(missBefore), inside(missAfter)]), 1.5 * floor) || 1;
    const s2 = scaleFor(o.unit, most / f), k = s2.factor / f;
    const y2 = d3.scaleLinear(padded(-most * k, most * k), [h2, 0]).nice(4);
    const g2 = svg.append('g').attr('transform', `translate(${left},${top + h + gap})`);
    const mask2 = clip(svg, w, h2);
    axes(g2, x, y2, w, h2, 'time [s]', `measured less simulated${s2.unit ? ` [${s2.unit}]` : ''}`);
    const plot2 = g2.append('g').attr('clip-path', mask2);
    plot2.append('rect').attr('class', 'floor-band').attr('width', w).attr('y', y2(floor * k)).attr('height', Math.max(0, y2(-floor * k) - y2(floor * k)));
    plot2.append('line').attr('class', 'zero').attr('x2', w).attr('y1', y2(0)).attr('y2', y2(0));
    plot2.append('path').attr('class', 'line before solid').attr('d', path(x, y2)(zip(t, scaled(missBefore, k))));
    if (missAfter.length) plot2.append('path').attr('class', 'line after').attr('d', path(x, y2)(zip(t, scaled(missAfter, k))));
    const cross = svg.append('g').attr('class', 'crosshair').attr('transform', `translate(${left},${top})`).style('display', 'none');
    cross.append('line').attr('y2', h + gap + h2);
    const brush = d3.brushX().extent([[0, 0], [w, h + gap + h2]]).on('end', () => {
      if (!d3.event.selection || !d3.event.sourceEvent) return;
      const [a, b] = d3.event.selection.map(x.invert);
      domain = b - a > (t[t.length - 1] - t[0]) / 2000 ? [a, b] : null;
      hideTip();
      paint();
    });
    svg.append('g').attr('class', 'brush').attr('transform', `translate(${left},${top})`).call(brush)
      .on('dblclick', () => { domain = null; paint(); })
      .on('mousemove.read', function () {
        const i = Math.min(t.length - 1, d3.bisectLeft(t, x.invert(d3.mouse(this)[0])));
        cross.style('display', null).attr('transform', `translate(${left + x(t[i])},${top})`);
        showTip(d3.event, [`${digits(t[i], 4)} s`, `measured ${show(o.measured[i], o.unit)}`, `${nominal} ${show(o.before[i], o.unit)}`, o.after.length ? `with the cause ${show(o.after[i], o.unit)}` : '', `floor ± ${show(o.floor, o.unit)}`].filter(Boolean).join('\n'));
      })
      .on('mouseleave.read', () => { cross.style('display', 'none'); hideTip(); });
    reset.hidden = domain === null;
    return top + h + gap + h2 + 40;
  }, () => columnRows(['time', 's', current.time_s], ['measured', current.unit, current.measured], [nominal, current.unit, current.before], ['simulation with the cause', current.unit, current.after]));
  runSelect.addEventListener('change', () => { domain = null; fillChannels(); paint(); });
  channelSelect.addEventListener('change', () => { domain = null; current = shown[+channelSelect.value]; paint(); });
  fillChannels();
};

// Small plots of one kind; more than `most` wait behind a button.
const grid = (s, items, most, small, build) => {
  const host = el('div', {class: 'grid' + (small ? ' small' : '')});
  s.append(host);
  const add = item => { const before = charts.length; build(host, item); return charts.slice(before); };
  items.slice(0, most).forEach(add);
  if (items.length > most) {
    const button = el('button', {type: 'button', on: {click: () => { for (const c of items.slice(most).flatMap(add)) c.paint(); button.parentElement.remove(); }}}, `Show all ${items.length}`);
    s.append(el('div', {class: 'controls', style: 'margin:10px 0 0'}, button));
  }
};

// ---- condition maps ----------------------------------------------------------------------------------------

const maps = s => {
  const shown = report.condition_maps.filter(m => m.at.length > 1 && m.mean.some(v => v !== null));
  if (!shown.length) return false;
  const strength = m => {
    const half = m.mean.map((v, i) => Math.max(1e-300, ((m.high[i] || 0) - (m.low[i] || 0)) / 2));
    return d3.max(m.mean, (v, i) => Math.abs(v || 0) / half[i]) || 0;
  };
  const start = (first[0] || strongest[0] || {}).cut;
  shown.sort((a, b) => (b.cut === start) - (a.cut === start) || strength(b) - strength(a));
  s.append(legend('before', 'band', ...(shown.some(m => m.after.length) ? ['after'] : [])));
  grid(s, shown, 6, false, (host, m) => {
    const scale = scaleFor(m.unit, largest([m.mean, m.low, m.high])), across = scaleFor(m.condition_unit, largest([m.at]));
    const card = el('div', {class: 'card'}, el('h3', {}, `${m.channel} `, el('small', {}, `${m.cut} · against ${m.condition}`)));
    host.append(card);
    chart(card, `${m.channel} against ${m.condition}`, (svg, width) => {
      const left = 48, w = width - left - 8, h = 150, top = 20;
      const at = scaled(m.at, across.factor), mean = scaled(m.mean, scale.factor), low = scaled(m.low, scale.factor), high = scaled(m.high, scale.factor), after = scaled(m.after, scale.factor);
      const values = [...mean, ...low, ...high, ...after, 0].filter(v => v !== null);
      const x = d3.scaleLinear(d3.extent(at), [0, w]), y = d3.scaleLinear(padded(d3.min(values), d3.max(values)), [h, 0]).nice(4);
      const g = svg.append('g').attr('transform', `translate(${left},${top})`);
      axes(g, x, y, w, h, `${m.condition}${across.unit ? ` [${across.unit}]` : ''}`, `residual${scale.unit ? ` [${scale.unit}]` : ''}`, {xTicks: 5});
      g.append('path').attr('class', 'before-band').attr('d', d3.area().defined((d, i) => low[i] !== null && high[i] !== null && at[i] !== null).x((d, i) => x(at[i])).y0((d, i) => y(low[i])).y1((d, i) => y(high[i]))(at));
      g.append('line').attr('class', 'zero').attr('x2', w).attr('y1', y(0)).attr('y2', y(0));
      g.append('path').attr('class', 'line before').attr('d', path(x, y)(zip(at, mean)));
      if (after.length) g.append('path').attr('class', 'line after').attr('d', path(x, y)(zip(at, after)));
      return top + h + 38;
    }, () => columnRows([m.condition, m.condition_unit, m.at], ['mean residual', m.unit, m.mean], ['low', m.unit, m.low], ['high', m.unit, m.high], ['with the cause', m.unit, m.after]));
  });
};

// ---- loops -------------------------------------------------------------------------------------------------

const loops = s => {
  const shown = report.overlays.filter(o => o.against && o.x.length > 2);
  if (!shown.length) return false;
  s.append(legend('measured', 'before-solid', ...(shown.some(o => o.after.length) ? ['after'] : [])));
  grid(s, shown, 6, false, (host, o) => {
    const scale = scaleFor(o.unit, largest([o.measured, o.before])), across = scaleFor(o.against_unit, largest([o.x]));
    const card = el('div', {class: 'card'}, el('h3', {}, `${o.channel} `, el('small', {}, `${o.run} · against ${o.against}`)));
    host.append(card);
    chart(card, `${o.channel} against ${o.against}`, (svg, width) => {
      const left = 48, w = width - left - 8, h = Math.min(250, width * .72), top = 20;
      const x0 = scaled(o.x, across.factor), measured = scaled(o.measured, scale.factor), before = scaled(o.before, scale.factor), after = scaled(o.after, scale.factor);
      const values = [...measured, ...before, ...after].filter(v => v !== null);
      const x = d3.scaleLinear(padded(d3.min(x0), d3.max(x0), .03), [0, w]), y = d3.scaleLinear(padded(d3.min(values), d3.max(values)), [h, 0]).nice(4);
      const g = svg.append('g').attr('transform', `translate(${left},${top})`);
      axes(g, x, y, w, h, `${o.against}${across.unit ? ` [${across.unit}]` : ''}`, scale.unit ? `[${scale.unit}]` : '', {xTicks: 5, yTicks: 5});
      g.append('path').attr('class', 'line measured').attr('d', path(x, y)(zip(x0, measured)));
      g.append('path').attr('class', 'line before solid').attr('d', path(x, y)(zip(x0, before)));
      if (after.length) g.append('path').attr('class', 'line after').attr('d', path(x, y)(zip(x0, after)));
      return top + h + 38;
    }, () => columnRows([o.against, o.against_unit, o.x], ['measured', o.unit, o.measured], [nominal, o.unit, o.before], ['simulation with the cause', o.unit, o.after]));
  });
};

// ---- horizon and correlations ------------------------------------------------------------------------------

const growth = s => {
  const points = report.horizon.filter(p => p.horizon_s > 0 && p.rms_m > 0);
  const correlations = report.input_correlations.filter(c => c.value !== null);
  const alone = report.free_runs || [];
  if (points.length < 2 && !correlations.length && !alone.length) return false;
  if (alone.length) {
    const withCause = alone.some(f => f.after_m !== null);
    const card = el('div', {class: 'card'}, el('div', {class: 'plot-title'}, 'Free run: the simulator under the same commands'),
      table([['kind of motion', 'c'], ['run', 'c'], ['length', 'n'], ['the tip moves, rms', 'n'], [`error, ${nominal}`, 'n'], ...(withCause ? [['error with the cause', 'n']] : [])],
        alone.map(f => ({cells: [plain(f.family), f.run, show(f.duration_s, 's'), show(f.moves_m, 'm'), show(f.before_m, 'm'), ...(withCause ? [show(f.after_m, 'm')] : [])]}))));
    card.append(el('p', {class: 'note'}, 'Plants that start at rest and see nothing of the run but the torques that were sent. All other errors here are of simulations that follow the measured signals.'));
    s.append(card);
  }
  const both = el('div', {class: points.length > 1 && correlations.length ? 'two' : ''});
  s.append(both);
  if (points.length > 1) {
    const card = el('div', {class: 'card'}, el('div', {class: 'plot-title'}, 'Error of the tip against how long the simulation runs by itself'), legend('before-solid', 'floor-line'));
    both.append(card);
    const scale = scaleFor('m', largest([points.map(p => p.rms_m)]));
    chart(card, 'Growth of the error with the horizon', (svg, width) => {
      const left = 52, w = width - left - 10, h = 220, top = 20;
      const values = points.flatMap(p => [p.rms_m, p.floor_m]).filter(v => v > 0).map(v => v * scale.factor);
      const x = d3.scaleLog(d3.extent(points, p => p.horizon_s), [0, w]), y = d3.scaleLog([d3.min(values) * .7, d3.max(values) * 1.4], [h, 0]);
      const g = svg.append('g').attr('transform', `translate(${left},${top})`);
      axes(g, x, y, w, h, 'time since the measured start [s]', `tip error, rms [${scale.unit}]`, {xTicks: 4, format: '~g'});
      g.append('path').attr('class', 'floor-line').attr('d', path(x, y)(points.filter(p => p.floor_m > 0).map(p => [p.horizon_s, p.floor_m * scale.factor])));
      g.append('path').attr('class', 'line before solid').attr('d', path(x, y)(points.map(p => [p.horizon_s, p.rms_m * scale.factor])));
      tipped(g.selectAll('circle').data(points).enter().append('circle').attr('class', 'fill-before').attr('r', 4).attr('cx', p => x(p.horizon_s)).attr('cy', p => y(p.rms_m * scale.factor)),
        p => `after ${show(p.horizon_s, 's')}: ${show(p.rms_m, 'm')} rms, floor ${show(p.floor_m, 'm')}`);
      return top + h + 38;
    }, () => columnRows(['time since the measured start', 's', points.map(p => p.horizon_s)], ['tip error, rms', 'm', points.map(p => p.rms_m)], ['floor', 'm', points.map(p => p.floor_m)]));
    card.append(el('p', {class: 'note'}, 'Flat: an offset of the sensors. Rising as the time: a wrong speed. Rising as its square: a wrong force.'));
  }
  if (correlations.length) {
    const card = el('div', {class: 'card'}, el('div', {class: 'plot-title'}, 'Correlation of the remaining residual with the inputs'));
    both.append(card);
    chart(card, 'Correlation of the residual with the inputs', (svg, width) => {
      const left = Math.min(200, width * .4), w = width - left - 50, step = 26, x = d3.scaleLinear([-1, 1], [0, w]).clamp(true);
      const g = svg.append('g').attr('transform', `translate(${left},18)`);
      g.append('g').attr('class', 'axis').call(d3.axisTop(x).ticks(5).tickSize(-correlations.length * step).tickSizeOuter(0)).call(a => { a.selectAll('line').style('stroke', 'var(--grid)'); a.select('.domain').remove(); });
      correlations.forEach((c, i) => {
        const v = c.value || 0, row = g.append('g').attr('transform', `translate(0,${i * step})`);
        row.append('text').attr('x', -10).attr('y', 18).attr('text-anchor', 'end').text(plain(c.name));
        row.append('rect').attr('class', Math.abs(v) > .3 ? 'fill-before' : 'bar cause').attr('x', Math.min(x(0), x(v))).attr('y', 6).attr('width', Math.abs(x(v) - x(0))).attr('height', 16);
        row.append('text').attr('class', 'tiny').attr('x', v < 0 ? x(v) - 6 : x(v) + 6).attr('y', 18).attr('text-anchor', v < 0 ? 'end' : 'start').text(digits(v, 2));
      });
      g.append('line').attr('class', 'zero').attr('x1', x(0)).attr('x2', x(0)).attr('y2', correlations.length * step);
      return 18 + correlations.length * step + 8;
    }, () => columnRows(['input', '', correlations.map(c => c.name)], ['correlation', '', correlations.map(c => c.value)]));
    card.append(el('p', {class: 'note'}, `Near 0: nothing of the inputs is left unexplained. What the best model leaves beyond the floor: ${digits(report.leftover_sigma, 2)} σ.`));
  }
};

// ---- rivals ------------------------------------------------------------------------------------------------

const rivals = s => {
  const pairs = report.confusable, profiles = report.profiles.filter(p => p.score.filter(v => v !== null).length > 1);
  if (!pairs.length && !profiles.length) return false;
  if (pairs.length) {
    // The names with the strongest likeness first; more than this many are in the table.
    const most = new Map();
    for (const p of pairs) for (const n of [p.a, p.b]) most.set(n, Math.max(most.get(n) || 0, Math.abs(p.cosine || 0)));
    const names = [...most.keys()].sort((a, b) => most.get(b) - most.get(a)).slice(0, 12);
    const between = (a, b) => pairs.find(p => (p.a === a && p.b === b) || (p.a === b && p.b === a));
    const label = n => { const [effect, where] = n.split(' '); return plain(effect) + (place(where) ? ` · ${place(where)}` : ''); };
    const card = el('div', {class: 'card'}), both = el('div', {class: 'matrix'}), left = el('div'), right = el('div');
    s.append(card);
    card.append(both);
    both.append(left, right);
    const ranked = [...pairs].sort((a, b) => Math.abs(b.cosine || 0) - Math.abs(a.cosine || 0));
    right.append(el('div', {class: 'plot-title'}, 'Most alike'), el('ul', {class: 'plain'}, ranked.slice(0, 6).map(p => el('li', {}, el('span', {class: 'likeness'}, digits(Math.abs(p.cosine || 0), 2)),
      el('span', {}, `${label(p.a)} and ${label(p.b)}`, el('br'), el('small', {class: p.confirmed ? 'problem' : 'quiet'}, p.confirmed ? 'cannot be told apart by these runs' : 'can be told apart'))))));
    chart(left, 'Similarity of the signatures of causes', (svg, width) => {
      const left = Math.min(230, width * .4), cell = Math.min(54, Math.max(26, (width - left - 10) / names.length)), head = 20;
      const g = svg.append('g').attr('transform', `translate(${left},${head})`);
      names.forEach((a, i) => {
        g.append('text').attr('x', -30).attr('y', i * cell + cell / 2 + 4).attr('text-anchor', 'end').text(label(a));
        g.append('text').attr('class', 'tiny soft').attr('x', -10).attr('y', i * cell + cell / 2 + 4).attr('text-anchor', 'end').text(i + 1);
        g.append('text').attr('class', 'tiny soft').attr('x', i * cell + cell / 2).attr('y', -7).attr('text-anchor', 'middle').text(i + 1);
        names.forEach((b, j) => {
          const pair = i === j ? null : between(a, b);
          const c = g.append('g').attr('transform', `translate(${j * cell},${i * cell})`);
          c.append('rect').attr('class', 'track').attr('width', cell - 2).attr('height', cell - 2).attr('rx', 4).style('opacity', i === j ? .35 : 1);
          if (!pair) return;
          const v = Math.abs(pair.cosine || 0);
          c.append('rect').attr('class', 'heat').attr('width', cell - 2).attr('height', cell - 2).attr('rx', 4).attr('opacity', Math.max(0, (v - .3) / .7) * .75);
          if (pair.confirmed) c.append('rect').attr('width', cell - 4).attr('height', cell - 4).attr('x', 1).attr('y', 1).attr('rx', 4).attr('fill', 'none').attr('stroke', 'var(--bad)').attr('stroke-width', 2.2);
          c.append('text').attr('class', 'tiny').attr('x', cell / 2 - 1).attr('y', cell / 2 + 3).attr('text-anchor', 'middle').text(cell >= 34 ? (pair.cosine || 0).toFixed(2).replace('-', '−').replace('0.', '.') : '');
          tipped(c, () => `${label(a)} and ${label(b)}\nsimilarity ${digits(pair.cosine, 3)} (1: the same signature)\nscore lost when one replaces the other: ${digits(pair.profile_gap, 2)} of log score\n${pair.confirmed ? 'cannot be told apart by these runs' : 'can be told apart'}`);
        });
      });
      return head + names.length * cell + 6;
    }, () => columnRows(['one', '', ranked.map(p => p.a)], ['other', '', ranked.map(p => p.b)], ['cosine', '', ranked.map(p => p.cosine)], ['score between', '', ranked.map(p => p.profile_gap)], ['cannot be told apart', '', ranked.map(p => p.confirmed)]));
    card.append(el('p', {class: 'note'}, '1 or −1: both have the same signature. Outlined in red: confirmed by refitting, these runs cannot tell the two apart.'),
      more(`All ${pairs.length} pairs as a table`, table([['one', 'c'], ['other', 'c'], ['cosine', 'n'], ['score between', 'n'], ['', 'c']],
        ranked.map(p => ({cells: [label(p.a), label(p.b), digits(p.cosine, 3), digits(p.profile_gap, 2), p.confirmed ? 'cannot be told apart' : '']})))));
  }
  if (profiles.length) {
    s.append(el('h3', {}, 'How well each number is determined'), el('p', {class: 'caption'}, 'A narrow valley: the runs fix the value. A flat line: any value would do.'));
    grid(s, profiles, 8, true, (host, p) => {
      const {word, unit} = p, scale = scaleFor(unit, largest([p.value]));
      const card = el('div', {class: 'card'}, el('h3', {}, causeText(p) + ' ', el('small', {}, word)));
      host.append(card);
      chart(card, `Score over ${p.effect} ${p.parameter}`, (svg, width) => {
        const left = 44, w = width - left - 8, h = 110, top = 20, value = scaled(p.value, scale.factor);
        const x = d3.scaleLinear(d3.extent(value), [0, w]), y = d3.scaleLinear([d3.min(p.score), padded(d3.min(p.score), d3.max(p.score))[1]], [h, 0]);
        const g = svg.append('g').attr('transform', `translate(${left},${top})`);
        axes(g, x, y, w, h, `${word || 'value'}${scale.unit ? ` [${scale.unit}]` : ''}`, 'score', {xTicks: 4, yTicks: 3});
        g.append('path').attr('class', 'line after').attr('d', path(x, y)(zip(value, p.score)));
        const best = d3.scan(p.score.map(v => v === null ? Infinity : v));
        g.append('circle').attr('class', 'fill-after').attr('r', 3.5).attr('cx', x(value[best])).attr('cy', y(p.score[best]));
        return top + h + 38;
      }, () => columnRows([p.parameter, p.unit, p.value], ['log score lost', '', p.score]));
    });
  }
};

// ---- next, health, provenance ------------------------------------------------------------------------------

const next = s => {
  const n = report.next_experiment;
  if (!n.family && !n.reason && !report.next_commands.length) return false;
  const card = el('div', {class: 'card'});
  s.append(card);
  for (const command of report.next_commands)
    card.append(el('div', {class: 'yaml command'}, el('pre', {}, command), copyButton(command)));
  if (n.family) card.append(el('div', {class: 'plot-title', style: 'font-size:16px'}, plain(n.family)));
  if (n.reason) card.append(el('p', {style: 'margin:2px 0 8px;max-width:80em'}, n.reason));
  const menu = [...(n.family ? [{name: n.family, value: n.separation_sigma}] : []), ...n.alternatives.filter(a => a.name !== n.family)];
  if (menu.length > 1) {
    chart(card, 'How far each experiment separates the rivals', (svg, width) => {
      const left = Math.min(220, width * .35), w = Math.min(560, width - left - 70), step = 26, x = d3.scaleLinear([0, d3.max(menu, m => m.value) || 1], [0, w]);
      const g = svg.append('g').attr('transform', `translate(${left},2)`);
      menu.forEach((m, i) => {
        const row = g.append('g').attr('transform', `translate(0,${i * step})`);
        row.append('text').attr('class', i === 0 ? 'bold' : '').attr('x', -12).attr('y', 15).attr('text-anchor', 'end').text(plain(m.name));
        row.append('rect').attr('class', i === 0 ? 'fill-after' : 'bar cause').attr('y', 3).attr('width', Math.max(1.5, x(m.value || 0))).attr('height', 16).attr('rx', 3);
        row.append('text').attr('x', x(m.value || 0) + 8).attr('y', 15).text(`${digits(m.value, 2)} σ`);
      });
      return menu.length * step + 6;
    }, () => columnRows(['experiment', '', menu.map(m => m.name)], ['separation', 'sigma', menu.map(m => m.value)]));
    card.append(el('p', {class: 'note'}, 'Longer bar: the rival causes would differ more in that run, in units of its noise.'));
  }
  if (n.yaml) card.append(el('div', {class: 'plot-title', style: 'margin-top:12px'}, 'The plan, next.yaml beside this report'), el('div', {class: 'yaml'}, el('pre', {}, n.yaml), copyButton(n.yaml)));
};

const health = s => {
  const words = {info: '○ note', warning: '▲ warning', error: '✖ error'};
  const rank = {error: 0, warning: 1, info: 2};
  const findings = [...report.data_health].sort((a, b) => rank[a.severity] - rank[b.severity]);
  const list = some => el('ul', {class: 'plain'}, some.map(f => el('li', {}, el('span', {class: `badge ${f.severity}`}, words[f.severity]),
    el('span', {}, [f.run, f.channel].filter(Boolean).length ? el('b', {}, [f.run, f.channel].filter(Boolean).join(', ') + ': ') : null, f.text))));
  const troubles = findings.filter(f => f.severity !== 'info'), notes = findings.filter(f => f.severity === 'info');
  const card = el('div', {class: 'card'});
  s.append(card);
  if (troubles.length) card.append(list(troubles));
  else card.append(el('p', {style: 'margin:0'}, '✓ No problem found: no clipping, gaps, dead channels or clock differences.'));
  if (notes.length) card.append(more(`${notes.length} routine note${notes.length === 1 ? '' : 's'}`, list(notes)));
};

const degradations = s => {
  if (!report.degradations.length) return false;
  const most = 6, list = some => el('ul', {class: 'plain'}, some.map(d => el('li', {}, el('span', {}, d))));
  const rest = report.degradations.slice(most);
  s.append(el('div', {class: 'card'}, list(report.degradations.slice(0, most)), rest.length ? more(`${rest.length} more`, list(rest)) : null));
};

const provenance = s => {
  const p = report.provenance;
  // JavaScript's numbers cannot hold every 64-bit seed: its digits as they were written.
  const seed = (source.match(/"seed":\s*(\d+)/) || [, String(p.seed)])[1];
  const rows = [['robot', p.robot_name], ['command', p.command], ['version', [p.version, p.revision].filter(Boolean).join(' · ')], ['seed', seed],
    ['materiality (δ)', `${show(p.delta_N, 'N')}, ${show(p.delta_m, 'm')}`], 
    ['held out, each in turn', p.held_out_families.map(plain).join(', ') || '–'], ['took', `${digits(p.seconds, 3)} s`]];
  const card = el('div', {class: 'card'}, table([['', 'c'], ['', 'c']], rows.map(([k, v]) => ({cells: [k, k === 'command' ? el('span', {class: 'mono'}, v) : v]}))));
  card.querySelector('thead').remove();
  if (p.runs.length) card.append(el('h3', {}, 'Runs'), table([['run', 'c'], ['family', 'c'], ['repeats', 'c'], ['duration', 'n'], ['rate', 'n'], ['samples', 'n'], ['SHA-256 of the file', 'mono']],
    p.runs.map(r => ({cells: [r.name, plain(r.family), r.repeat_of || '–', `${digits(r.duration_s, 3)} s`, `${digits(r.rate_Hz, 4)} Hz`, String(r.samples), r.sha256 || '–']}))));
  if (p.robot_yaml) card.append(more('Nominal robot file, resolved', el('div', {class: 'yaml'}, el('pre', {}, p.robot_yaml), copyButton(p.robot_yaml))));
  s.append(card);
};

try { facts(); } catch (error) { problems.push(`facts: ${error.message}`); console.error(error); }
section('where', 'Where the gap lies', 'Where', 'Each box feeds what was measured before it into the model of one part of the robot and compares what comes out with what was measured after it; colour shows how far the difference exceeds the noise.', chain);
section('cause', 'Which effect causes it', 'Cause', 'Each bar is the probability of one explanation, judged on held-out runs, which were not used to find it; “no gap” and “unknown” compete with the rest.', causes);
section('closed', 'How far the gap shrinks', 'Closed', 'The difference between robot and simulation before and after the cause is put into the simulator, on held-out runs; dotted lines mark the noise floor, below which nothing can be gained.', closing);
section('runs', 'Held-out runs, measured and simulated', 'Runs', `The robot against the ${nominal} and the corrected one over time; below, the error of each. A good result stays within the grey band.`, overlays);
section('conditions', 'When the difference appears', 'Conditions', 'The mean difference (measured less simulated) against one condition at a time: a step at zero speed hints at friction, a slope at a wrong scale, a bow at a wrong law.', maps);
section('loops', 'Hysteresis loops', 'Loops', 'The same runs as loops: width is energy lost to friction, tilt is stiffness, a flat stretch at the turns is play. The simulation should trace the measured loop.', loops);
section('growth', 'What remains, and how errors grow', 'Left over', 'How fast the simulation drifts from the robot once it runs freely, and whether what remains still follows the inputs.', growth);
section('rivals', 'Which causes look alike', 'Rivals', 'How similar the signatures of two causes would be in these runs; do not trust the likeliest of a look-alike group without another experiment.', rivals);
section('next', 'What to do next', 'Next', 'To copy into a shell. Where explanations remain: the run from the menu that would separate them most, within the limits of this robot.', next);
section('health', 'Health of the data', 'Data', 'What was noticed in the logs themselves, what it means for the diagnosis, and the remedy.', health);
section('limits', 'What these logs cannot tell', 'Limits', 'Missing sensors, repeats or runs narrow what can be said; this is what they cost.', degradations);
section('provenance', 'Where this comes from', 'Provenance', 'Everything needed to make the same report again.', provenance);

// ---- width, paper, navigation ------------------------------------------------------------------------------

let lastWidth = window.innerWidth, timer = 0;
window.addEventListener('resize', () => {
  clearTimeout(timer);
  timer = setTimeout(() => { if (window.innerWidth !== lastWidth) { lastWidth = window.innerWidth; charts.forEach(c => c.paint()); } }, 150);
});
window.addEventListener('beforeprint', () => charts.forEach(c => c.paint(c.host.closest('.grid.small') ? 210 : c.host.closest('.grid, .two') ? 310 : c.host.closest('.matrix') ? 390 : 650)));
window.addEventListener('afterprint', () => charts.forEach(c => c.paint()));
if ('IntersectionObserver' in window) {
  const links = new Map([...nav.children].map(a => [a.getAttribute('href').slice(1), a]));
  const watcher = new IntersectionObserver(entries => {
    for (const e of entries) if (e.isIntersecting) { links.forEach(a => a.classList.remove('here')); links.get(e.target.id).classList.add('here'); }
  }, {rootMargin: '-10% 0px -80% 0px'});
  links.forEach((a, id) => watcher.observe(document.getElementById(id)));
}
window.addEventListener('error', e => { problems.push(e.message); document.documentElement.dataset.problems = problems.join(' | '); });
if (problems.length) document.documentElement.dataset.problems = problems.join(' | ');
document.documentElement.dataset.charts = charts.length;
window.reportWords = {show, percent};  // for what else reads this page
})();
