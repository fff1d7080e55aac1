"""`audit verify` and `audit sign`: integrity of a report, its repetition, a signature of it."""

import json
import sys
import tempfile
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated

import tyro

from socialiq.audit.conduct import conduct
from socialiq.audit.profile.reader import parse
from socialiq.audit.report import recompute, signature, verify, words
from socialiq.audit.report.folder import PROFILE, REPORT, SIGNATURES, STATEMENT, tables_of
from socialiq.audit.report.references import Findings
from socialiq.audit.request import Request, is_code
from socialiq.audit.seeds import read_nonce
from socialiq.cli.audit import Code, CodeOptions, Several
from socialiq.cli.output import Printing, complain, print_json, say
from socialiq.cli.signing import fault_of_model, path_of_signature, private_copy, sign_model
from socialiq.cli.words import refuse_unused
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.policies.onnx_data import DATA_FILES, ONE_FILE
from socialiq.provenance import package_sha256
from socialiq.reading import sha256_of_file
from socialiq.storage import write_atomically
from socialiq.types import Files, Json


@dataclass(frozen=True)
class RerunOptions:
    """Repetition of a report's episodes."""

    rerun: bool = False
    """Run all episodes again, which needs policy and references with the same hashes."""
    world: str = ""
    """The environment, if that of the declaration runs code: a report may come from
    an untrusted source, so you name it yourself."""
    reference: Several = ()
    """Paths of the user's references: with them these are driven again too."""
    code: Code = field(default_factory=CodeOptions)
    threads: int = 1
    """Number of threads of the simulation."""

    def check(self, folder: Path, all_episodes: bool = False) -> Findings:
        """Check a folder as `verify.check_folder`; refuse options that only a rerun uses."""
        if not self.rerun:
            refuse_unused(self, ("world", "threads"), "--rerun")
            refuse_unused(self.code, [field.name for field in fields(self.code)], "--rerun")
        specs = () if self.rerun else self.reference  # a rerun drives them anyway
        return verify.check_folder(folder, specs, all_episodes)

    def faults(self, files: Files, report: Json, policy: str) -> list[str]:
        """Run the audit again and compare; a report, maybe untrusted, doesn't choose the code.

        Args:
            files: Content of the report's files by path.
            report: Content of `report.json`.
            policy: Where the policy is; "" for the place that the report names.
        """
        if report["hashes"]["package"] != package_sha256():
            complain("this package's code is not that of the report: numbers may differ")
        world = parse(files[PROFILE], PROFILE).scenario.world
        source = policy or str(report["policy"]["record"]["source"])
        references = tuple(self.reference or report["reference_files"])
        code = [(world, "--world")] if ":" in world and self.world != world else []
        code += [(source, "--policy")] if not policy and is_code(source) else []
        reported = () if self.reference else references
        code += [(reference, "--reference") for reference in reported if is_code(reference)]
        for what, option in code[:1]:
            raise UserError(
                f"this report asks to run '{one_line(what)}': if you trust that, give it as "
                f"{option} yourself"
            )
        with tempfile.TemporaryDirectory() as folder:
            profile = Path(folder) / PROFILE
            profile.write_bytes(files[PROFILE])
            request = Request(
                policy=source,
                profile=profile,
                episodes=report["seeds"]["episodes"],
                references=references,
                soft=not report["policy"]["deterministic"],
                trust=self.code.trust,
                threads=self.threads,
                shift=recompute.named_in(report),
            )
            done = conduct(request, say, recompute.opened_of(report))
        fresh = json.loads(json.dumps(done.report))
        tables = tables_of(done.audited.evidence)
        differing = [name for name in tables if files.get(name) != tables[name]]
        paths = [*differing, *recompute.differences(report, fresh)]
        return [f"{path} differs in the rerun" for path in paths]


Again = tyro.conf.OmitArgPrefixes[RerunOptions]
"""The options of a rerun, without a word before them."""


@dataclass(frozen=True)
class Verify(Printing):
    """Check that a report follows from its episodes; with --rerun repeat the audit and compare.

    It prints what was checked and what was not. Exit status: 0 consistent, 1 different, 2 a mistake
    in the call, 3 consistent as far as checked, but another version of socialiq wrote parts that
    this one can't check.

    Example: socialiq audit verify audit --rerun
    """

    folder: Annotated[Path, tyro.conf.Positional]
    """Report folder, of `socialiq audit --out`."""
    all_episodes: bool = False
    """Drive all episodes of the reference drivers again, not a sample."""
    again: Again = field(default_factory=RerunOptions)
    policy: str = ""
    """Path of the policy, if not that of the report."""
    log: Path | None = None
    """The file of the audit log that you hold, to check that the report is one of its looks, and
    which."""
    nonce: Path | None = None
    """The file of your nonce, to check that it was drawn by you and revealed for this audit."""
    key: Path | None = None
    """The signer's public key, a PEM file, to check that the report is signed by it; with --policy
    also the signature FILE.sig of the policy, if there is one."""

    def run(self) -> int:
        """Check, optionally rerun, and print what was checked and what differs."""
        rerun = self.again.rerun
        if not rerun and self.key is None:
            refuse_unused(self, ("policy",), "--rerun")
        key = None if self.key is None else signature.read_public_key(self.key)
        findings = self.again.check(self.folder, self.all_episodes)
        faults = findings.faults
        files = findings.files
        report = {} if faults else verify.report_of(files, self.folder)
        checked = list(findings.checked)
        if key is not None and not faults:
            faults = signature.faults_of_signature(files, key)
            checked.append(f"signature by the key {signature.key_id(key)}")
            policy = Path(self.policy)
            signed = policy.is_file() and path_of_signature(policy).is_file()
            if not faults and self.key is not None and signed:
                checked.append("signature of the policy")
                with private_copy(policy) as copy:
                    fault = _fault_of_policy(report, copy, policy)
                    fault = fault or fault_of_model(copy, path_of_signature(policy), self.key)
                faults = [fault] if fault else []
        if self.log is not None and not faults:
            faults = verify.faults_by_log(files[REPORT], report, self.log)
            checked.append("audit log")
        if self.nonce is not None and not faults:
            faults = verify.faults_by_nonce(report, read_nonce(self.nonce))
            checked.append("auditor's nonce")
        if rerun and not faults:
            faults = self.again.faults(files, report, self.policy)
            checked.append("episodes, run again")
        claims = [] if faults else list(report["claims_of_auditor"])
        if self.log is not None and words.OF_A_LOG in claims:
            claims.remove(words.OF_A_LOG)
        if self.json:
            row = {"folder": str(self.folder), "rerun": rerun, "faults": faults}
            row |= {"not_checked": findings.not_checked, "checked": [] if faults else checked}
            print_json(row | {"claims": claims})
        else:
            for line in _shortened(faults):
                complain(line)
            if not faults:
                self._print(findings, report, checked, claims)
        return 1 if faults else 3 if findings.not_checked else 0

    def _print(
        self, findings: Findings, report: Json, checked: list[str], claims: list[str]
    ) -> None:
        """Print what was checked, and what is left to believe."""
        unknown = findings.not_checked
        if unknown:
            line = (
                f"is not checked as a whole: this version of socialiq would not write "
                f"{', '.join(_shortened(unknown))}, which may say anything; verify with the "
                "version that did"
            )
        else:
            again = ", and so does a rerun of the episodes" if self.again.rerun else ""
            line = f"is consistent: what it says follows from its episodes{again}"
        sys.stdout.write(f"{self.folder} {line}\nchecked: {'; '.join(checked)}\n")
        left = [] if self.again.rerun else [*findings.believed, _MOVED]
        if self.nonce is None and report["seeds"]["nonce"] is not None:
            left.append("who drew the nonce, and for whom (--nonce)")
        if self.key is None:
            how = (
                "--key checks its signatures"
                if SIGNATURES in findings.files
                else "it is not signed"
            )
            left.append(f"who wrote it ({how})")
        left.append(f"claims of the auditor ({', '.join(claims)})")
        sys.stdout.write(f"left to believe: {'; '.join(left)}\n")


_MOVED = "how the vehicles moved (--rerun)"
_MOST_LINES = 12


def _shortened(lines: list[str]) -> list[str]:
    """Return the first lines, and how many more there are."""
    remaining = len(lines) - _MOST_LINES
    return [*lines[:_MOST_LINES], f"and {remaining} more"] if remaining > 0 else lines


def _fault_of_policy(report: Json, copy: Path, policy: Path) -> str:
    """Return why a copy of a policy's file is not the policy that was audited; "" if it is."""
    if report["policy"].get(DATA_FILES):
        return f"{policy} is one of several files, and a signature covers one: {ONE_FILE}"
    if sha256_of_file(copy) == report["hashes"]["policy"]:
        return ""
    return f"{policy} is not the policy that was audited: its hash differs"


@dataclass(frozen=True)
class Sign(Printing):
    """Sign the statement of a report, which has the hash of every file.

    A report that `audit verify` finds different, or can't check, is not signed: status 1 or 3. With
    --rerun all but the auditor's claims is checked, else --believe signs what can't be. What was
    not checked is printed. Owner and auditor may both sign. SOCIALIQ_KEY_PASSPHRASE opens an
    encrypted key.

    Example: socialiq audit sign audit --key private.pem --rerun
    """

    folder: Annotated[Path, tyro.conf.Positional]
    """Report folder, of `socialiq audit --out`."""
    key: Path
    """Your private key, a PEM file: Ed25519, or ECDSA on the curve P-256."""
    policy: str = ""
    """The policy's file, to sign it too: FILE.sig, in the format of OpenSSF Model Signing, which
    takes a P-256 key and needs the extra `signing`. Code is not signed: it is where a rerun finds
    it."""
    believe: bool = False
    """Sign what is not checked: the policy's episodes and how the vehicles moved."""
    again: Again = field(default_factory=RerunOptions)

    def run(self) -> int:
        """Check the folder, sign, write `statement.dsse.json`, and the policy's signature."""
        key = signature.read_private_key(self.key)
        findings = self.again.check(self.folder)
        content = findings.files
        faults = findings.faults
        rerun = self.again.rerun
        report = {} if faults else verify.report_of(content, self.folder)
        believed = [] if rerun else [*findings.believed, _MOVED]
        if report and not findings.not_checked and not rerun and not self.believe:
            raise UserError(
                f"{self.folder} is not signed, because this is not checked: {'; '.join(believed)}. "
                "Add --rerun to check it, or --believe"
            )
        if report and not findings.not_checked and rerun:
            faults = self.again.faults(content, report, self.policy)
        for line in _shortened(faults):
            complain(line)
        for name in findings.not_checked:
            complain(f"{name} is not checked: sign with the version of socialiq that wrote it")
        if faults or findings.not_checked:
            return 1 if faults else 3
        files = {}
        if self.policy and not is_code(self.policy):
            policy = Path(self.policy)
            with private_copy(policy) as copy:
                if fault := _fault_of_policy(report, copy, policy):
                    raise UserError(fault)
                files[path_of_signature(policy)] = sign_model(copy, self.key)
        envelope = signature.signed(content[STATEMENT], key, content.get(SIGNATURES))
        files = {self.folder / SIGNATURES: envelope} | files
        for path, text in files.items():
            write_atomically(path, text)
        signer = signature.key_id(key.public_key())
        believed.append(f"claims of the auditor ({', '.join(report['claims_of_auditor'])})")
        if self.json:
            names = [str(path) for path in files]
            print_json({"key": signer, "files": names, "believed": believed})
        else:
            for path in files:
                sys.stdout.write(f"{path}: signed by the key {signer}\n")
            sys.stdout.write(f"signed without a check: {'; '.join(believed)}\n")
        return 0
