"""CITATION.cff: how Spikelane is cited."""

from pathlib import Path
import re

import yaml

ROOT = Path(__file__).parents[2]
PACKAGES = ('controllers', 'sim_bridge', 'ros2_ws/src/spikelane')


def test_the_citation_has_the_version_of_the_packages() -> None:
    """That of pyproject.toml, which each setup.py reads, and of each package.xml."""
    citation = yaml.safe_load((ROOT / 'CITATION.cff').read_text('utf-8'))
    files = ['pyproject.toml', *(f'{folder}/package.xml' for folder in PACKAGES)]
    pattern = r'^version = \'([^\']+)\'|<version>([^<]+)<'
    versions = [re.search(pattern, (ROOT / file).read_text('utf-8'), re.M) for file in files]
    found = [match[1] or match[2] for match in versions if match]
    assert found == [citation['version']] * 4


def test_the_citation_names_the_paper() -> None:
    """By what finds it."""
    citation = yaml.safe_load((ROOT / 'CITATION.cff').read_text('utf-8'))
    assert {'cff-version', 'message', 'title', 'authors'} <= set(citation)
    [paper] = citation['references']
    assert paper['doi'] == '10.1016/j.neunet.2019.05.019'
    assert [each['family-names'] for each in paper['authors']] == [
        'Bing',
        'Meschede',
        'Chen',
        'Knoll',
        'Huang',
    ]
