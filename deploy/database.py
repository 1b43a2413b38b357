"""Says whether a release may become the current one: `install.sh` runs this by its Python.

An older release refuses a database that a newer one has written. Exit status 2 and one line then.
A machine without a database, or whose server does not answer, is no reason to refuse.
"""

import os
import sys
import tomllib
from pathlib import Path

HOME = Path("/var/lib/slipstream")  # where the dispatcher's unit starts it


def main(site: Path) -> int:
    """Compare the schema of a site's database with what this release knows."""
    try:
        from sqlalchemy.exc import SQLAlchemyError

        from slipstream.errors import InputError
        from storage import schema
        from storage.engine import display_name, is_sqlite, parse_url, reader_engine, sqlite_path
    except ModuleNotFoundError:
        return 0  # a release for machines without a database
    try:
        url = parse_url(
            tomllib.loads(site.read_text()).get("database_url", "sqlite:///slipstream.db")
        )
        source = display_name(url)
        if is_sqlite(url):
            path = HOME / sqlite_path(url)
            if not path.is_file():
                return 0
            if os.geteuid() == 0:  # files beside the database stay the dispatcher's
                os.setgid(path.stat().st_gid)
                os.setuid(path.stat().st_uid)
            url = url.set(database=str(path))
        engine = reader_engine(url)
        with engine.connect() as connection:
            schema.check_ownership(connection, source)
    except tomllib.TOMLDecodeError:
        return 0  # `slipstream check` tells it
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    except SQLAlchemyError as error:
        print(f"{source}: not looked at: {' '.join(str(error).split())[:200]}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
