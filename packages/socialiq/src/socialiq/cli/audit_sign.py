"""`audit sign`: a signature of an audit's statement."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from socialiq.audit.report.folder import REPORT, SIGNATURES, STATEMENT
from socialiq.audit.report.signature import key_id, read_private_key, signed
from socialiq.audit.report.verify import check_folder, content_of, read_report
from socialiq.cli.output import Printing, complain, print_json
from socialiq.errors import UserError
from socialiq.policies.model_signature import path_of_signature, sign_model
from socialiq.reading import sha256_of_file
from socialiq.storage import write_atomically


@dataclass(frozen=True)
class Sign(Printing):
    """Sign the statement of a report, which has the hash of every file.

    A report that `audit verify` finds different, or can't check, is not signed: status 1 or 3.
    Owner and auditor may both sign. SOCIALIQ_KEY_PASSPHRASE opens an encrypted key.

    Example: socialiq audit sign audit --key private.pem
    """

    folder: Annotated[Path, tyro.conf.Positional]
    """Report folder, of `socialiq audit --out`."""
    key: Path
    """Your private key, a PEM file: Ed25519, or ECDSA on the curve P-256."""
    policy: Path | None = None
    """The policy's file, to sign it too: FILE.sig, in the format of OpenSSF Model Signing, which
    takes a P-256 key and needs the extra `signing`."""

    def run(self) -> int:
        """Check the folder, sign, write `statement.dsse.json`, and the policy's signature."""
        key = read_private_key(self.key)
        findings = check_folder(self.folder)
        for line in findings.faults:
            complain(line)
        for name in findings.not_checked:
            complain(f"{name} is not checked: sign with the version of socialiq that wrote it")
        if findings.faults or findings.not_checked:
            return 1 if findings.faults else 3
        files, written = content_of(self.folder), [self.folder / SIGNATURES]
        model = None if self.policy is None else self._of_policy(self.policy)
        envelope = signed(files[STATEMENT], key, files.get(SIGNATURES))
        write_atomically(self.folder / SIGNATURES, envelope)
        if self.policy is not None and model is not None:
            written.append(path_of_signature(self.policy))
            write_atomically(written[-1], model)
        signer = key_id(key.public_key())
        if self.json:
            print_json({"key": signer, "files": [str(path) for path in written]})
        else:
            for path in written:
                sys.stdout.write(f"{path}: signed by the key {signer}\n")
        return 0

    def _of_policy(self, policy: Path) -> bytes:
        """Return the signature of the policy, if it is the one that was audited."""
        audited = read_report(self.folder / REPORT)["hashes"]["policy"]
        if sha256_of_file(policy) != audited:
            raise UserError(f"{policy} is not the policy that was audited: its hash differs")
        return sign_model(policy, self.key)
