"""The study file: read, overridden from the command line, checked, explained and written again."""

from contact_locking.files.readable import file_digest as file_digest

from .dump import dump as dump
from .fingerprint import fingerprint as fingerprint
from .fingerprint import fit_fingerprint as fit_fingerprint
from .fingerprint import mesh_identity as mesh_identity
from .fingerprint import problem_fingerprint as problem_fingerprint
from .reading import StudyFile as StudyFile
from .reading import from_mapping as from_mapping
from .reading import load as load
from .reading import require_parameters as require_parameters
from .schema import schema as schema
from .schema import schema_text as schema_text
