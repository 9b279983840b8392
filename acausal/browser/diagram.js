/* A model's graph, laid out by ELK, as SVG. Runs in a browser and in Duktape: ECMAScript 5 only.

   diagramLayout(graph, opened, elk)   lays out; `opened` has the paths of composites whose inside is shown
   diagramSvg(layout)                  the picture                                                            */

/* Plain colours, no variables: programs that print and convert SVG know neither var() nor color-mix(). */
var _DIAGRAM_LIGHT = { paper: "#ffffff", text: "#23272d", faint: "#6b7480", frame: "#c3c9d0", inside: "#f6f7f9",
  multibody: "#6d7177", translational: "#1f7a1f", rotational: "#7a5a1e", electrical: "#1d4fd0", thermal: "#bf2020",
  signal: "#26357f", boolean: "#b0209a", integer: "#c8700a", other: "#0f7f7f" };
var _DIAGRAM_DARK = { paper: "#1b1e23", text: "#e4e7eb", faint: "#98a1ac", frame: "#4a515b", inside: "#23272e",
  multibody: "#b3b9c1", translational: "#5fc05f", rotational: "#d3a95c", electrical: "#7ea2ff", thermal: "#ff7b6e",
  signal: "#9fb0ff", boolean: "#ee77dd", integer: "#ffb055", other: "#4fc7c7" };

function _diagramColors(c) {
  var rules = "svg.diagram{background:" + c.paper + "}.diagram .sheet{fill:" + c.paper + "}.diagram .sym .b,.diagram .box,.diagram .hollow{fill:" + c.paper + "}" +
    ".diagram .compound{fill:" + c.inside + ";stroke:" + c.frame + "}.diagram .name,.diagram .sym .t{fill:" + c.text + "}" +
    ".diagram .cls,.diagram .port{fill:" + c.faint + "}.diagram .sym .a{stroke:" + c.faint + "}";
  var kinds = ["multibody", "translational", "rotational", "electrical", "thermal", "signal", "boolean", "integer", "other"];
  for (var i = 0; i < kinds.length; i++) rules += ".diagram ." + kinds[i] + "{color:" + c[kinds[i]] + "}";
  return rules;
}

var DIAGRAM_STYLE =
  "svg.diagram{font-family:'DejaVu Sans',Verdana,system-ui,sans-serif}" +
  ".diagram .sym path,.diagram .sym rect,.diagram .sym circle{fill:none;stroke:currentColor;stroke-width:1.5;stroke-linejoin:round}" +
  ".diagram .sym .f{fill:currentColor;fill-opacity:0.3}.diagram .sym .w{stroke-width:3}.diagram .sym .a{stroke-width:1}.diagram .sym .d{stroke-dasharray:3 3}" +
  ".diagram .sym .field{stroke:none;fill:transparent;fill-opacity:0}.diagram .t{stroke:none;text-anchor:middle}" +
  ".diagram .box{stroke:currentColor;stroke-width:1.4}.diagram .compound{stroke-width:1.2}" +
  ".diagram .name{font-size:11px;text-anchor:middle}.diagram .cls{font-size:9px;text-anchor:middle}.diagram .title{text-anchor:start;font-weight:600}" +
  ".diagram .port{font-size:8px}.diagram .edge{fill:none;stroke:currentColor}.diagram .openable{cursor:pointer}" +
  _diagramColors(_DIAGRAM_LIGHT) + "@media (prefers-color-scheme:dark){" + _diagramColors(_DIAGRAM_DARK) + "}";

var _DIAGRAM_OPTIONS = {
  "elk.algorithm": "layered", "elk.direction": "RIGHT", "elk.edgeRouting": "ORTHOGONAL",
  "elk.hierarchyHandling": "INCLUDE_CHILDREN", "elk.spacing.nodeNode": "26", "elk.spacing.edgeNode": "14", "elk.spacing.edgeEdge": "9",
  "elk.layered.spacing.nodeNodeBetweenLayers": "34", "elk.layered.spacing.edgeNodeBetweenLayers": "14", "elk.layered.spacing.edgeEdgeBetweenLayers": "9",
  "elk.layered.mergeHierarchyEdges": "false", "elk.padding": "[top=14,left=14,bottom=14,right=14]", "elk.layered.thoroughness": "20", "elk.spacing.portPort": "15"
};
var _DIAGRAM_SIDE = { W: "WEST", E: "EAST", N: "NORTH", S: "SOUTH" };

function _diagramText(text) {
  return String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;").replace(/"/g, "&quot;");
}

function _diagramWidth(text, size) {
  return 0.62 * size * String(text).length;
}

/* All blocks by path, with their owners. */
function _diagramIndex(block, owner, found) {
  found[block.path] = { block: block, owner: owner };
  for (var i = 0; i < block.blocks.length; i++) _diagramIndex(block.blocks[i], block.path, found);
  return found;
}

function _diagramId(path, port) {
  return "p:" + path + "|" + port;
}

/* A block as a node of ELK; `opened` ones hold their parts. */
function _diagramNode(block, opened, isRoot) {
  var isOpen = (isRoot || opened[block.path]) && block.blocks.length > 0;
  var node = { id: "n:" + block.path, block: block, isOpen: isOpen, ports: [], children: [], layoutOptions: {} };
  var sides = { W: [], E: [], N: [], S: [] }, i;
  for (i = 0; i < block.ports.length; i++) {
    var port = block.ports[i];
    sides[port.side].push(port);
    var wide = port.direction === "" ? 6 : 0.1;
    node.ports.push({
      id: _diagramId(block.path, port.name), width: wide, height: wide, port: port,
      layoutOptions: { "elk.port.side": _DIAGRAM_SIDE[port.side], "elk.port.borderOffset": "0" }
    });
  }
  node.layoutOptions["elk.portConstraints"] = "FIXED_SIDE";
  node.layoutOptions["elk.portAlignment.default"] = "CENTER";
  node.layoutOptions["elk.spacing.portPort"] = "15";
  if (isOpen) {
    for (var option in _DIAGRAM_OPTIONS) node.layoutOptions[option] = _DIAGRAM_OPTIONS[option];
    node.layoutOptions["elk.padding"] = isRoot ? "[top=34,left=30,bottom=18,right=30]" : "[top=26,left=26,bottom=14,right=26]";
    for (i = 0; i < block.blocks.length; i++) node.children.push(_diagramNode(block.blocks[i], opened, false));
    return node;
  }
  node.hasSymbol = block.symbol !== "" && Math.max(sides.W.length, sides.E.length) <= 2;
  var label = Math.max(_diagramWidth(block.name, 11), _diagramWidth(_diagramSecond(block), 9));
  if (node.hasSymbol) {
    node.width = 60;
    node.height = 40;
    node.isBelow = sides.S.length === 0;
    // Beside the line of a connector above; as much room at the other side, because ELK centres labels.
    node.isBeside = !node.isBelow && sides.N.length > 0;
    node.labels = [{ text: block.name, width: Math.max(20, node.isBeside ? 2 * label + 14 : label), height: _diagramSecond(block) ? 24 : 13 }];
    node.layoutOptions["elk.nodeLabels.placement"] = "OUTSIDE H_CENTER " + (node.isBelow ? "V_BOTTOM" : "V_TOP");
    return node;
  }
  var names = function (list) {
    var most = 0;
    for (var k = 0; k < list.length; k++) most = Math.max(most, _diagramWidth(list[k].name, 8));
    return most;
  };
  var needed = 2 * Math.max(names(sides.W), names(sides.E)) + 16;
  node.namedPorts = Math.max(sides.W.length, sides.E.length) > 1;
  node.width = Math.max(70, label + 20, node.namedPorts ? needed + label : 0, 26 * Math.max(sides.N.length, sides.S.length));
  var room = function (list) {
    var total = 10;
    for (var k = 0; k < list.length; k++) total += list[k].direction === "" ? 22 : 16;
    return total;
  };
  node.height = Math.max(46, room(sides.W), room(sides.E));
  return node;
}

/* The second line below a name: the first value that was given, else the class where it says more. */
function _diagramSecond(block) {
  if (block.symbol && block.values.length) return block.values[0];
  return block.symbol ? "" : block.cls;
}

function _diagramNodes(node, found) {
  found[node.block.path] = node;
  for (var i = 0; i < node.children.length; i++) _diagramNodes(node.children[i], found);
  return found;
}

/* Where an end is drawn: at its own block, or at the closed one that holds it. */
function _diagramEnd(end, index, nodes) {
  var path = end[0];
  while (!nodes[path]) path = index[path].owner;
  var node = nodes[path], name = path === end[0] ? end[1] : end[0].slice(path.length ? path.length + 1 : 0) + "." + end[1];
  var id = _diagramId(path, name);
  for (var i = 0; i < node.ports.length; i++) if (node.ports[i].id === id) return id;
  node.ports.push({ id: id, width: 6, height: 6, port: { name: name, side: "E", domain: "other", direction: "" }, layoutOptions: {} });
  return id;
}

function _diagramEdges(block, index, nodes, edges) {
  if (!nodes[block.path] || !nodes[block.path].isOpen) return edges;
  for (var i = 0; i < block.edges.length; i++) {
    var edge = block.edges[i];
    edges.push({
      id: "e:" + block.path + ":" + i, edge: edge,
      // Loops of signals are cut where they go back to a part that was declared before.
      layoutOptions: { "elk.layered.priority.direction": edge.directed && edge.forward ? "10" : "0" },
      sources: [_diagramEnd(edge.from, index, nodes)], targets: [_diagramEnd(edge.to, index, nodes)]
    });
  }
  for (i = 0; i < block.blocks.length; i++) _diagramEdges(block.blocks[i], index, nodes, edges);
  return edges;
}

/* The graph that ELK gets; what belongs to us is taken off again by `_diagramPlain`. */
function diagramElk(graph, opened) {
  var root = _diagramNode(graph, opened, true), nodes = _diagramNodes(root, {});
  var edges = _diagramEdges(graph, _diagramIndex(graph, null, {}), nodes, []);
  return { id: "root", layoutOptions: _DIAGRAM_OPTIONS, children: [root], edges: edges };
}

function _diagramPlain(key, value) {
  return key === "block" || key === "edge" || key === "port" ? undefined : value;
}

/* Lay out by ELK's worker, `done(layout)` with a graph that has places, blocks and edges. */
function diagramLayout(graph, opened, Worker, done, failed) {
  var elk = diagramElk(graph, opened), worker = new Worker("elk");
  worker.onmessage = function (message) {
    var answer = message.data;
    if (answer.id !== 1) return;
    if (answer.error) return failed(answer.error);
    _diagramJoin(elk, answer.data);
    done(answer.data);
  };
  worker.postMessage({ id: 0, cmd: "register", algorithms: ["layered"] });
  worker.postMessage({ id: 1, cmd: "layout", graph: JSON.parse(JSON.stringify(elk, _diagramPlain)), layoutOptions: {}, options: {} });
}

function _diagramJoin(ours, theirs) {
  var i;
  theirs.block = ours.block; theirs.isOpen = ours.isOpen; theirs.hasSymbol = ours.hasSymbol; theirs.namedPorts = ours.namedPorts; theirs.isBelow = ours.isBelow; theirs.isBeside = ours.isBeside;
  for (i = 0; ours.ports && i < ours.ports.length; i++) theirs.ports[i].port = ours.ports[i].port;
  for (i = 0; ours.children && i < ours.children.length; i++) _diagramJoin(ours.children[i], theirs.children[i]);
  for (i = 0; ours.edges && i < ours.edges.length; i++) theirs.edges[i].edge = ours.edges[i].edge;
}

/* Places of nodes relative to the picture. */
function _diagramPlaces(node, x, y, found) {
  found[node.id] = { x: x + (node.x || 0), y: y + (node.y || 0) };
  var here = found[node.id];
  for (var i = 0; node.children && i < node.children.length; i++) _diagramPlaces(node.children[i], here.x, here.y, found);
  return found;
}

function diagramSvg(layout) {
  var out = [], places = _diagramPlaces(layout, 0, 0, {}), root = layout.children[0];
  var width = Math.ceil(layout.width), height = Math.ceil(layout.height);
  out.push('<svg xmlns="http://www.w3.org/2000/svg" class="diagram" width="' + width + '" height="' + height + '" viewBox="0 0 ' + width + " " + height + '">');
  out.push("<style>" + DIAGRAM_STYLE + "</style>");
  out.push('<rect class="sheet" width="' + width + '" height="' + height + '"/>');
  _diagramDraw(root, places, out, true);
  for (var i = 0; i < layout.edges.length; i++) _diagramDrawEdge(layout.edges[i], places, out);
  _diagramDrawPorts(root, places, out);
  out.push("</svg>");
  return out.join("\n");
}

function _diagramTitle(block) {
  var lines = [block.path ? block.path + ": " + block.cls : block.cls];
  if (block.doc) lines.push(block.doc);
  return "<title>" + _diagramText(lines.concat(block.values).join("\n")) + "</title>";
}

function _diagramDraw(node, places, out, isRoot) {
  var block = node.block, at = places[node.id], canOpen = !isRoot && block.blocks.length > 0, i;
  out.push('<g class="node ' + block.domain + (canOpen ? " openable" : "") + '" data-path="' + _diagramText(block.path) + '">' + _diagramTitle(block));
  if (node.isOpen) {
    out.push('<rect class="compound" x="' + at.x + '" y="' + at.y + '" width="' + node.width + '" height="' + node.height + '" rx="5"/>');
    out.push('<text class="name title" x="' + (at.x + 10) + '" y="' + (at.y + 16) + '" >' + _diagramText(block.name) +
      (isRoot || block.cls === block.name ? "" : ' <tspan class="cls" style="font-weight:400;font-size:11px">' + _diagramText(block.cls) + "</tspan>") + "</text></g>");
    for (i = 0; i < node.children.length; i++) _diagramDraw(node.children[i], places, out, false);
    return;
  }
  var middle = at.x + node.width / 2, second = _diagramSecond(block);
  if (node.hasSymbol) {
    out.push('<g class="sym" transform="translate(' + at.x + " " + at.y + ')"><rect width="60" height="40" class="field"/>' + block.symbol + "</g>");
    var line = node.isBelow ? at.y + node.height + 12 : at.y - (second ? 15 : 5);
    var where = node.isBeside ? ' style="text-anchor:start" x="' + (middle + 7) : ' x="' + middle;
    out.push('<text class="name"' + where + '" y="' + line + '">' + _diagramText(block.name) + "</text>");
    if (second) out.push('<text class="cls"' + where + '" y="' + (line + 11) + '">' + _diagramText(second) + "</text>");
  } else {
    out.push('<rect class="box" x="' + at.x + '" y="' + at.y + '" width="' + node.width + '" height="' + node.height + '" rx="3"/>');
    out.push('<text class="name" x="' + middle + '" y="' + (at.y + node.height / 2 - 1) + '">' + _diagramText(block.name) + "</text>");
    if (second !== block.name) out.push('<text class="cls" x="' + middle + '" y="' + (at.y + node.height / 2 + 11) + '">' + _diagramText(second) + "</text>");
    if (canOpen) out.push('<text class="cls" x="' + (at.x + node.width - 8) + '" y="' + (at.y + 11) + '">+</text>');
  }
  out.push("</g>");
}

function _diagramDrawEdge(edge, places, out) {
  var at = places[edge.container] || { x: 0, y: 0 }, kind = edge.edge.domain, i, k;
  var thick = kind === "multibody" ? 2.6 : kind === "signal" || kind === "boolean" || kind === "integer" ? 1.2 : 1.7;
  out.push('<g class="' + kind + '" data-edge="' + _diagramText(edge.edge.from.join(".") + " - " + edge.edge.to.join(".")) + '">');
  for (i = 0; edge.sections && i < edge.sections.length; i++) {
    var section = edge.sections[i], points = [section.startPoint].concat(section.bendPoints || [], [section.endPoint]), path = [];
    for (k = 0; k < points.length; k++) path.push((at.x + points[k].x) + " " + (at.y + points[k].y));
    out.push('<path class="edge" stroke-width="' + thick + '" d="M' + path.join("L") + '"/>');
    if (edge.edge.directed) out.push(_diagramArrow(points[points.length - 2], points[points.length - 1], at));
  }
  for (i = 0; edge.junctionPoints && i < edge.junctionPoints.length; i++) {
    out.push('<circle cx="' + (at.x + edge.junctionPoints[i].x) + '" cy="' + (at.y + edge.junctionPoints[i].y) + '" r="2.6" fill="currentColor"/>');
  }
  out.push("</g>");
}

function _diagramArrow(before, end, at) {
  var dx = end.x - before.x, dy = end.y - before.y, length = Math.sqrt(dx * dx + dy * dy) || 1;
  dx /= length; dy /= length;
  var x = at.x + end.x, y = at.y + end.y, bx = x - 8 * dx, by = y - 8 * dy;
  return '<path d="M' + x + " " + y + "L" + (bx - 3.5 * dy) + " " + (by + 3.5 * dx) + "L" + (bx + 3.5 * dy) + " " + (by - 3.5 * dx) + 'Z" fill="currentColor"/>';
}

function _diagramDrawPorts(node, places, out) {
  var at = places[node.id], i;
  for (i = 0; node.ports && i < node.ports.length; i++) {
    var place = node.ports[i], port = place.port, x = at.x + place.x, y = at.y + place.y;
    var isSignal = port.direction !== "";
    out.push('<g class="' + port.domain + '"><title>' + _diagramText(port.name) + "</title>");
    if (!isSignal) out.push('<rect x="' + x + '" y="' + y + '" width="6" height="6" ' + (port.side === "E" ? 'class="hollow"' : 'fill="currentColor"') + ' stroke="currentColor"/>');
    if (node.isOpen || node.namedPorts) {
      // Inside of the border; where lines go on there, above them.
      if (port.side === "W" || port.side === "E") {
        var anchor = port.side === "W" ? "start" : "end", dx = port.side === "W" ? place.width + 3 : -3;
        var dy = place.height / 2 + (node.isOpen ? -4 : 3);
        out.push('<text class="port" x="' + (x + dx) + '" y="' + (y + dy) + '" style="text-anchor:' + anchor + '">' + _diagramText(port.name) + "</text>");
      }
    }
    out.push("</g>");
  }
  for (i = 0; node.children && i < node.children.length; i++) _diagramDrawPorts(node.children[i], places, out);
}
