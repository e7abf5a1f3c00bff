"""Move the words of a chapter of evidence out of its cells."""
import ast, re, subprocess, sys, json
from pathlib import Path
import yaml

root = Path(sys.argv[1]); chapter = sys.argv[2]
path = root / f"chapters/evidence/{chapter}.md"
text = path.read_text()
RESERVED = {"name","value","unit","interval","interval_kind","runs","basis","role","how","tolerance","share","frame","fold","fig","condition","self"}
USUAL = {
 "p1-training": dict(), "p1-outages": dict(), "p1-lmi": {"basis":"algebra"}, "p2-fusion": {},
 "p3-vehicle": {"share":0.002}, "printed-numbers": {"basis":"printed","tolerance":1e-9,"share":0.0,"interval_kind":"rounding"},
 "recorded-data": {"basis":"recorded","tolerance":0.01,"share":0.02,"interval_kind":"confidence 95 %"},
}[chapter]
usual = {"basis":"simulation","tolerance":1e-6,"share":1e-3,"interval_kind":"runs 95 %"} | USUAL
out = {"quantities":{}, "sentences":{}, "shown":{}}
f0 = root/f"data/evidence/{chapter}.yaml"
if f0.exists():
    old = yaml.safe_load(f0.read_text())
    for k in out: out[k].update(old.get(k) or {})
left = []

class Dynamic(Exception): pass

def fname(node):
    if isinstance(node, ast.Name): n = node.id
    elif isinstance(node, ast.Attribute): n = node.attr
    elif isinstance(node, ast.Subscript):
        n = fname(node.value)
        if isinstance(node.slice, ast.Constant): n += f"_{node.slice.value}"
    elif isinstance(node, ast.Call):
        f = node.func
        if isinstance(f, ast.Attribute) and f.attr in ("replace","strip","lower","join","removeprefix","removesuffix","split","format"):
            n = fname(f.value) if not isinstance(f.value, ast.Constant) else (fname(node.args[0]) if node.args else "words")
        else: n = fname(f)
    elif isinstance(node, ast.BinOp): n = fname(node.left) if not isinstance(node.left, ast.Constant) else fname(node.right)
    elif isinstance(node, ast.IfExp): n = fname(node.body)
    elif isinstance(node, ast.Constant): n = re.sub(r"\W+","_",str(node.value)).strip("_")[:12] or "word"
    elif isinstance(node, (ast.GeneratorExp, ast.ListComp)): n = fname(node.elt)
    elif isinstance(node, ast.UnaryOp): n = fname(node.operand)
    else: n = "x"
    n = re.sub(r"\W+","_",n).strip("_").lower() or "x"
    if not n[0].isalpha(): n = "n"+n
    return n

class Gaps:
    def __init__(self): self.values = {}  # name -> source
    def add(self, node, source):
        n = fname(node)
        if n in RESERVED: n += "_"
        base, k = n, 1
        while n in self.values and self.values[n] != source:
            k += 1; n = f"{base}{k}"
        self.values[n] = source
        return n
    def text(self, node):
        if isinstance(node, ast.Constant) and isinstance(node.value, str): return node.value
        if isinstance(node, ast.JoinedStr):
            t = ""
            for v in node.values:
                if isinstance(v, ast.Constant): t += v.value
                else:
                    src = ast.unparse(v.value)
                    if v.conversion == 114: src = f"repr({src})"
                    spec = ""
                    if v.format_spec:
                        if any(not isinstance(p, ast.Constant) for p in v.format_spec.values):
                            raise Dynamic("format spec")
                        spec = ":" + "".join(p.value for p in v.format_spec.values)
                    t += "{" + self.add(v.value, src) + spec + "}"
            return t
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
            return self.text(node.left) + self.text(node.right)
        return "{" + self.add(node, ast.unparse(node)) + "}"

def const(node):
    try: return ast.literal_eval(node)
    except Exception: raise Dynamic(ast.unparse(node)[:40])
def is_const(node):
    try: ast.literal_eval(node); return True
    except Exception: return False

def seg(node): return ast.unparse(node)

def quantity_call(call, fn):
    args = {}
    names = ["name","value","unit","how"] if fn != "quantity" else ["name","value","unit"]
    for n, a in zip(names, call.args): args[n] = a
    for k in call.keywords:
        if k.arg is None: raise Dynamic("**")
        args[k.arg] = k.value
    if len(call.args) > len(names): raise Dynamic("positional")
    if isinstance(args["name"], ast.Name): raise Dynamic("name is a variable")
    if isinstance(args["how"], (ast.Name, ast.Attribute)): raise Dynamic("how is a variable")
    gaps = Gaps(); entry = {}; given = {}
    name = gaps.text(args["name"])
    unit = args["unit"]
    if is_const(unit): entry["unit"] = const(unit)
    else: given["unit"] = seg(unit)
    how = gaps.text(args["how"])
    basis = args.get("basis")
    if basis is None:
        if fn == "keep" and chapter == "p1-lmi": b = "simulation" if "count" in args else "algebra"
        elif fn == "keep" and chapter == "p2-fusion": b = "algebra" if name.startswith("theorem.") else "simulation"
        elif fn == "keep" and chapter in ("printed-numbers","recorded-data"): b = usual["basis"]
        elif fn in ("keep","note"): b = "simulation"
        else: raise Dynamic("no basis")
        if chapter == "p1-lmi" and "count" in args and is_const(args["count"]) and const(args["count"]) == 1: b = "algebra"
    elif is_const(basis): b = const(basis)
    else: given["basis"] = seg(basis); b = None
    if b and b != usual["basis"]: entry["basis"] = b
    if "role" in args:
        if is_const(args["role"]): 
            if const(args["role"]) != "found": entry["role"] = const(args["role"])
        else: given["role"] = seg(args["role"])
    # tolerance
    if fn == "quantity":
        tol = const(args["tolerance"]); share = const(args["share"]) if "share" in args else 0.0
    else:
        base = usual if fn == "keep" else {"tolerance":1e-6,"share":1e-3}
        tol, share = base["tolerance"], base["share"]
        if "absolute" in args:
            if is_const(args["absolute"]): tol = const(args["absolute"])
            else: given["tolerance"] = seg(args["absolute"])
        if "relative" in args:
            if is_const(args["relative"]): share = const(args["relative"])
            else: given["share"] = seg(args["relative"])
        if "tolerance" in args:
            share = 0.0
            if is_const(args["tolerance"]): tol = const(args["tolerance"])
            else: given["tolerance"] = seg(args["tolerance"]); given["share"] = "0.0"
    if (tol, share) != (usual["tolerance"], usual["share"]):
        if tol != usual["tolerance"] or True: entry["tolerance"] = tol
        if share != 0.0: entry["share"] = share
        elif tol == usual["tolerance"]: entry["share"] = 0.0
    if "interval" in args:
        given["interval"] = seg(args["interval"])
        kind = args.get("kind") if fn != "quantity" else args.get("interval_kind")
        if kind is None:
            if fn == "quantity" or chapter in ("printed-numbers","recorded-data"):
                k = "rounding" if b == "printed" else "confidence 95 %"
            else: k = "runs 95 %"
        elif is_const(kind): k = const(kind)
        else: k = None; given["interval_kind"] = seg(kind)
        if k and k != usual["interval_kind"]: entry["interval_kind"] = k
    for r in ("count","runs"):
        if r in args and not (is_const(args[r]) and const(args[r]) == 1): given["runs"] = seg(args[r])
    known = {"name","value","unit","how","basis","role","absolute","relative","tolerance","share","interval","kind","interval_kind","count","runs"}
    if set(args) - known: raise Dynamic(str(set(args)-known))
    entry = {"how": how} | entry
    if name in out["quantities"] and out["quantities"][name] != entry:
        raise Dynamic(f"{name} differs")
    out["quantities"][name] = entry
    kw = "".join(f", {k}={v}" for k, v in (given | gaps.values).items())
    return f"record.keep({json.dumps(name, ensure_ascii=False)}, {seg(args['value'])}{kw})"

STOP = set("a an the of in is are and by to its it that than with at as for on from each all has have be than if".split())
def slug(textv):
    words = [w for w in re.findall(r"[a-z0-9]+", re.sub(r"\{\w+(:[^}]*)?\}"," ",textv.lower())) if w not in STOP]
    s = words[0]; 
    for w in words[1:]:
        if len(s) + len(w) > 38: break
        s += "-" + w
    base, k = s, 1
    while s in out["sentences"] and out["sentences"][s] != textv:
        k += 1; s = f"{base}-{k}"
    return s

def holds_call(call):
    if len(call.args) != 2 or call.keywords: raise Dynamic("holds")
    if isinstance(call.args[0], ast.Name): raise Dynamic("holds var")
    gaps = Gaps(); t = gaps.text(call.args[0])
    s = slug(t); out["sentences"][s] = t
    kw = "".join(f", {k}={v}" for k, v in gaps.values.items())
    return f"record.bind({json.dumps(s)}, {seg(call.args[1])}{kw})"

def shown_call(call, fn):
    kws = {k.arg: k.value for k in call.keywords}
    if None in kws or len(call.args) != 1: raise Dynamic("shown")
    name = const(kws.pop("name"))
    gaps = Gaps(); entry = {"caption": gaps.text(kws.pop("caption"))}
    if "alt" in kws: entry["alt"] = gaps.text(kws.pop("alt"))
    extra = "".join(f", {k}={seg(v)}" for k, v in kws.items())
    out["shown"][name] = entry
    kw = "".join(f", {k}={v}" for k, v in gaps.values.items())
    return f"record.{fn.removeprefix('show_')}({seg(call.args[0])}, name={json.dumps(name)}{extra}{kw})"

def convert(code):
    try: tree = ast.parse(code)
    except SyntaxError: return code
    lines = code.split("\n"); offs = [0]
    for l in lines: offs.append(offs[-1] + len(l.encode()) + 1)
    raw = code.encode(); edits = []
    for node in ast.walk(tree):
        if not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)) and not isinstance(node, ast.Call): continue
        call = node.value if isinstance(node, ast.Expr) else node
        f = call.func
        fn = f.id if isinstance(f, ast.Name) else (f.attr if isinstance(f, ast.Attribute) and isinstance(f.value, ast.Name) and f.value.id == "record" else None)
        if fn not in ("keep","note","quantity","holds","show_table","show_figure"): continue
        if isinstance(f, ast.Attribute) and fn == "keep": continue
        try:
            new = quantity_call(call, fn) if fn in ("keep","note","quantity") else holds_call(call) if fn == "holds" else shown_call(call, fn)
        except (Dynamic, KeyError) as e:
            left.append(f"{fn}: {e}: {ast.unparse(call)[:110]}"); continue
        a = offs[call.lineno-1] + call.col_offset; b = offs[call.end_lineno-1] + call.end_col_offset
        edits.append((a, b, new))
    done = set()
    for a, b, new in sorted(set(edits), reverse=True):
        raw = raw[:a] + new.encode() + raw[b:]
    return raw.decode()

def fmt(code):
    p = subprocess.run([str(root/".venv/bin/ruff"),"format","--line-length","88","--isolated","--target-version","py311","-"], input=code, text=True, capture_output=True)
    if p.returncode: print(p.stderr[:300]); return code
    return p.stdout.rstrip("\n")

def cell(m):
    head, body = m.group(1), m.group(2)
    if ":tags: [parameters]" in head: return m.group(0)
    body = convert(body)
    body = body.replace(f"record = ChapterRecord(\"{chapter}\", globals())", f"record = EvidenceRecord(\"{chapter}\", globals())").replace("from inswsn_book.record import ChapterRecord", "from inswsn_book.evidence.page import EvidenceRecord")
    return head + fmt(body) + "\n```"
new = re.sub(r"(```\{code-cell\} ipython3\n(?::tags: [^\n]*\n)?\n*)(.*?)\n```(?=\n|$)", cell, text, flags=re.S)
path.write_text(new)
f0.parent.mkdir(exist_ok=True)
PLAIN = re.compile(r"[A-Za-z][A-Za-z/]*( 95 %)?")
def flow(d):
    last = {"how": d["how"]} if "how" in d else {}
    d = {k: v for k, v in d.items() if k != "how"} | last
    return "{" + ", ".join(f"{k}: " + (v if isinstance(v, str) and PLAIN.fullmatch(v) and v.lower() not in ("true","false","null") else json.dumps(v, ensure_ascii=False)) for k, v in d.items()) + "}"
def scalar(t): return yaml.dump(t, width=10**9, allow_unicode=True, default_style=None).replace("\n...","").strip()
w = [f"# The words of {chapter}: what its numbers, sentences, tables and figures are; see inswsn_book.evidence.page"]
if USUAL: w.append(f"usual: {flow(USUAL)}")
for k in ("quantities","sentences","shown"):
    w.append(f"{k}:")
    for n, e in out[k].items():
        if k == "shown":
            w.append(f"  {n}:"); w += [f"    {kk}: {json.dumps(v, ensure_ascii=False)}" for kk, v in e.items()]
        elif k == "sentences": w.append(f"  {n}: {json.dumps(e, ensure_ascii=False)}")
        else: w.append(f"  {json.dumps(n) if '{' in n else n}: {flow(e)}")
f0.write_text("\n".join(w) + "\n")
print(chapter, "quantities", len(out["quantities"]), "sentences", len(out["sentences"]), "shown", len(out["shown"]), "left", len(left))
for l in left: print("   ", l)
code_cells = re.findall(r"```\{code-cell\} ipython3\n(.*?)\n```", new, re.S)
print("lines", new.count("\n"), "was", text.count("\n"), "over25", sum(c.count("\n")>27 for c in code_cells), "over88", sum(len(l)>88 for c in code_cells for l in c.split("\n")))
