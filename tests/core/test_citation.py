"""CITATION.cff: how Spikelane is cited."""

from pathlib import Path
import re

import yaml

ROOT = Path(__file__).parents[2]


def test_the_citation_has_the_version_of_the_packages() -> None:
    """That of setup.py and package.xml, in each of the packages."""
    citation = yaml.safe_load((ROOT / 'CITATION.cff').read_text('utf-8'))
    setups = [ROOT / 'controllers', ROOT / 'sim_bridge', ROOT / 'ros2_ws/src/spikelane']
    versions = {
        re.search(pattern, (folder / name).read_text('utf-8'))[1]  # type: ignore[index]
        for folder in setups
        for name, pattern in (
            ('setup.py', r"version='([^']+)'"),
            ('package.xml', r'<version>([^<]+)<'),
        )
    }
    assert versions == {citation['version']}


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
