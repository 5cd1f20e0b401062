"""Remarks on the constants and fields of a source, so that what is generated from them says the same."""

import ast
import io
import tokenize


def remarks_of(source: str) -> dict[str, str]:
    """Return the remarks on names that a module or a class assigns: the comment behind, or the text below.

    Parameters
    ----------
    source : str
        Of the module or the class.
    """
    comments = {
        token.start[0]: token.string.lstrip("# ")
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type == tokenize.COMMENT
    }
    body = ast.parse(source).body
    body = body[0].body if len(body) == 1 and isinstance(body[0], ast.ClassDef) else body
    remarks: dict[str, str] = {}
    for statement, below in zip(body, [*body[1:], None], strict=True):
        if not isinstance(statement, (ast.Assign, ast.AnnAssign)):
            continue
        target = statement.targets[0] if isinstance(statement, ast.Assign) else statement.target
        names = target.elts if isinstance(target, ast.Tuple) else [target]
        remark = comments.get(statement.end_lineno or 0, "")
        if not remark and isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            remark = " ".join(str(below.value.value).split())
        remarks |= {name.id: remark for name in names if isinstance(name, ast.Name)}
    return remarks
