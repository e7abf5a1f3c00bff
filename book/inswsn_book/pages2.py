from jinja2 import Environment, FileSystemLoader, StrictUndefined
from inswsn_book import review
from inswsn_book.review import *
from inswsn_book.ledger import PAPERS, LEDGER, load_claims
from inswsn_book.verdicts import count_verdicts, verdicts
def environment(root):
    book=root/"book"
    env=Environment(loader=FileSystemLoader([book, book/"_templates"]), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True, extensions=["jinja2.ext.do"])
    env.filters |= {"escape_text": review.escape_text, "number": lambda v,f="g": format(v,f).replace("-","−"), "one_line": lambda t: " ".join(t.split())}
    env.globals |= {"claim_link": review.claim_link, "papers": PAPERS, "count_verdicts": count_verdicts, "judged_anew": review.judged_anew, "other_claims": review.other_claims}
    return env
def context(project, results):
    judged=verdicts(load_claims(project.root/LEDGER), results)
    findings=review.Findings(results, judged)
    return {"findings": findings, "errata": review.load_errata(project.root), "readings": review.load_readings(project.root)}
    
_old_context=context
def plain(value):
    if isinstance(value, (list,tuple)): return f"({', '.join(map(plain, value))})"
    return f"{value:.5g}" if isinstance(value, float) else str(value)
def quantity(x):
    value = x.value if hasattr(x,"value") else x.default
    return plain(value) + ("" if x.unit == "1" else f" {x.unit}")
def context(project, results):
    from inswsn_book import effects, study
    ctx=_old_context(project, results)
    a=review.load_assumptions(project.root); s=study.read_study(project.root/study.SENSITIVITY)
    tables={c: effects.rows_of(a,s,c) for c in a.reduced}
    readings=effects.readings_of(a, ctx["findings"])
    def chance_band(study, h):
        vals=[r.headlines.get(h.key) for r in study.seeds(h.chapter)]
        return effects.band_of([v for v in vals if v is not None])
    from inswsn_book.files import tree_digest, file_digest
    def changed_sources(sources):
        now={"library": project.computing_digest(), "locks": tree_digest(project.root, project.locks), **{f"chapter {c.number}": file_digest(c.source) for c in project.chapters()}}
        return [n for n,d in sources.items() if n in now and now[n]!=d]
    ctx |= {"assumptions": a, "study": s, "study_tables": tables, "study_readings": readings, "study_summary": effects.summarise(a,tables,readings), "study_panels": effects.panels_of(tables), "moves": effects.MOVES, "change_text": effects.change_text, "chance_band": chance_band, "changed_sources": changed_sources, "settings": review.load_settings(project.root), "schemas": review.load_schemas(project)}
    return ctx
_old_env=environment
def environment(root):
    env=_old_env(root); env.filters["quantity"]=quantity; return env
