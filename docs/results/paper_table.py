#!/usr/bin/env python3
"""Prints the tables of docs/results/paper.md from the report that `spikelane reproduce` has made.

source setup/env.sh; docs/results/paper_table.py [runs/paper/report]
"""

from __future__ import annotations

from pathlib import Path
import sys

from tables import print_row, read_json

TABLES = ("Results against the paper's", 'Settings')


def main() -> None:
    """Print the tables."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else 'runs/paper/report')
    report = read_json(folder / 'report.json')
    for table in report['tables']:
        if table['title'] in TABLES:
            print(f'## {table["title"]}\n')
            print_row(*table['header'])
            print_row(*['---'] * len(table['header']))
            for row in table['rows']:
                print_row(*row)
            print(f'\n{table["note"]}\n')
    for made in report['made_with']:
        print(f'{made["runs"]} runs at commit {made["commit"]}: {made["machine"]}, ', end='')
        print(f'{made["versions"]}.')


if __name__ == '__main__':
    main()
