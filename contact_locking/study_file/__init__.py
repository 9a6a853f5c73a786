"""The study file: read, overridden from the command line, checked, explained and written again."""

from contact_locking.files import file_digest as file_digest
from contact_locking.study_file.dump import dump as dump
from contact_locking.study_file.dump import fingerprint as fingerprint
from contact_locking.study_file.dump import fit_fingerprint as fit_fingerprint
from contact_locking.study_file.dump import mesh_identity as mesh_identity
from contact_locking.study_file.dump import problem_fingerprint as problem_fingerprint
from contact_locking.study_file.reading import StudyFile as StudyFile
from contact_locking.study_file.reading import from_mapping as from_mapping
from contact_locking.study_file.reading import load as load
from contact_locking.study_file.reading import require_parameters as require_parameters
from contact_locking.study_file.schema import schema as schema
from contact_locking.study_file.schema import schema_text as schema_text
