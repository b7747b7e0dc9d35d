"""Installs requirements into the environment of the Python that runs this, with uv.

    .venv/bin/python -I setup/install.py [--no-deps] [--python OTHER] -r FILE [-r FILE ...]

uv installs what pip would, in a quarter of the time, and environments share its files. It does not
read pip's settings: those that say where packages come from are passed on. pip does the work where
one of them is unknown here, and where the environment sees the packages of an installed ROS, which
uv would install once more.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping, Sequence
import os
from pathlib import Path
import re
import subprocess
import sys

PIP = (sys.executable, '-I', '-m', 'pip')
QUIETLY = ('--quiet', '--no-input', '--disable-pip-version-check', '--no-compile', '--retries=2')

#: Sections of pip's settings that concern `pip install`, and from which the later one counts.
_SECTIONS = ('global', 'install', ':env:')
#: Options of uv for pip's settings. Each can have several values, with white space between them.
_OPTIONS = {
    'index-url': '--default-index',
    'extra-index-url': '--index',
    'find-links': '--find-links',
    'trusted-host': '--allow-insecure-host',
    'constraint': '--constraints',
    'no-binary': '--no-binary-package',
}
#: Variables that uv reads for pip's settings.
_VARIABLES = {
    'cert': 'SSL_CERT_FILE',
    'client-cert': 'SSL_CLIENT_CERT',
    'default-timeout': 'UV_HTTP_TIMEOUT',
    'proxy': 'ALL_PROXY',
    'timeout': 'UV_HTTP_TIMEOUT',
}
#: Settings that change nothing in what is installed.
_IGNORED = {
    *('break-system-packages', 'cache-dir', 'compile', 'disable-pip-version-check', 'log'),
    *('no-cache-dir', 'no-color', 'no-compile', 'no-input', 'no-warn-script-location'),
    *('progress-bar', 'quiet', 'require-virtualenv', 'retries', 'root-user-action', 'user'),
    *('verbose',),
}


def pip_settings(listed: str) -> dict[str, str]:
    """Return the settings in what `pip config list` prints, such as "global.cert='/ca.crt'"."""
    found: dict[str, dict[str, str]] = {section: {} for section in _SECTIONS}
    for line in listed.splitlines():
        match = re.match(r'(:env:|\w+)\.([\w-]+)=(.*)', line)
        if match and match[1] in found:
            found[match[1]][match[2].replace('_', '-')] = str(ast.literal_eval(match[3]))
    return {name: value for section in _SECTIONS for name, value in found[section].items()}


def is_known(settings: Mapping[str, str]) -> bool:
    """Whether uv can be told all of pip's settings."""
    return set(settings) <= {*_OPTIONS, *_VARIABLES, *_IGNORED}


def uv_options(settings: Mapping[str, str]) -> Iterator[str]:
    """Yield the options of uv for pip's settings."""
    for name, option in _OPTIONS.items():
        for value in settings.get(name, '').split():
            yield f'{option}={value}'
            if name == 'constraint':  # in the environment it holds for what pip builds, too
                yield f'--build-constraints={value}'


def uv_variables(settings: Mapping[str, str]) -> dict[str, str]:
    """Return the variables of uv for pip's settings."""
    return {
        variable: settings[name] for name, variable in _VARIABLES.items() if settings.get(name)
    }


def sees_other_packages() -> bool:
    """Whether the environment has the packages of the Python that it was made with."""
    text = Path(sys.prefix, 'pyvenv.cfg').read_text(encoding='utf-8')
    return re.search(r'^include-system-site-packages *= *true', text, re.M) is not None


def main(arguments: Sequence[str]) -> int:
    """Install; return the exit status."""
    listed = subprocess.run([*PIP, 'config', 'list'], capture_output=True, text=True, check=False)
    settings = pip_settings(listed.stdout)
    if sees_other_packages() or not is_known(settings):
        return subprocess.run([*PIP, 'install', *QUIETLY, *arguments], check=False).returncode
    uv = Path(sys.prefix, 'bin/uv')
    done = subprocess.run([*PIP, 'install', *QUIETLY, 'uv'], check=False)
    if done.returncode:
        return done.returncode
    command = [str(uv), 'pip', 'install', '--quiet']
    command += [] if '--python' in arguments else ['--python', sys.executable]
    # As pip does, the best version is taken of all indices.
    command += ['--index-strategy=unsafe-best-match', *uv_options(settings), *arguments]
    variables = os.environ | uv_variables(settings)
    return subprocess.run(command, env=variables, check=False).returncode


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
