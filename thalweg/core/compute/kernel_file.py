"""Files of compiled kernels: Numba's, with the key and a hash of its content in each, so that no other code is run.

Numba keeps a numbered file for each signature of a function, and an index of them. It takes whatever file the index
names for the code of that signature. Two processes that store two signatures at once may give both the same number, and
a machine that loses its power may leave a file without its content.
"""

import hashlib
import pickle
from typing import Any

from numba.core import caching

DIGEST_BYTES = hashlib.sha256().digest_size


class KernelFile(caching.IndexDataCacheFile):
    """The index and the files of a function; whatever is damaged, or belongs to another signature, is not there."""

    def save(self, key: Any, data: Any) -> None:
        """Store the code of a signature; raises `OSError` where it cannot be written."""
        super().save(key, (key, data))

    def load(self, key: Any) -> Any:
        """Return the stored code of a signature, or None."""
        stored_key, data = super().load(key) or (None, None)
        return data if stored_key == key else None

    def _load_index(self) -> dict[Any, str]:
        try:
            return super()._load_index()
        except Exception:  # a damaged pickle fails in many ways
            return {}

    def _load_data(self, name: str) -> Any:
        """Return what was stored in a file; raises `OSError`, which `load` takes for a file that is not there."""
        with open(self._data_path(name), "rb") as file:
            digest, content = file.read(DIGEST_BYTES), file.read()
        if hashlib.sha256(content).digest() != digest:
            raise OSError(f"{name} is damaged")
        return pickle.loads(content)

    def _save_data(self, name: str, data: Any) -> None:
        content = self._dump(data)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(hashlib.sha256(content).digest() + content)
