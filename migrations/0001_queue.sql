-- The queue: data sets, jobs with their inputs, attempts and events.
-- Times are milliseconds since 1970. Every state named here is named in
-- src/job/machine.rs, and no state changes but by its table.

CREATE TABLE data_set (
    id         INTEGER PRIMARY KEY,
    path       TEXT    NOT NULL UNIQUE,           -- the file or folder that was dropped
    kind       TEXT    NOT NULL CHECK (kind IN ('file', 'folder')),
    name       TEXT    NOT NULL UNIQUE,           -- its folder under octrees/
    stamp      TEXT    NOT NULL,                  -- sizes and times of its files when last taken
    revision   INTEGER NOT NULL DEFAULT 0,        -- contents seen so far
    job        INTEGER REFERENCES job (id),       -- the job that stands for its present content
    created_at INTEGER NOT NULL,
    updated_at INTEGER NOT NULL
) STRICT;

CREATE TABLE job (
    id            INTEGER PRIMARY KEY,
    data_set      INTEGER NOT NULL REFERENCES data_set (id),
    name          TEXT    NOT NULL,
    source        TEXT    NOT NULL,
    revision      INTEGER NOT NULL,
    content_key   TEXT    NOT NULL,
    state         TEXT    NOT NULL CHECK (state IN
                  ('queued', 'running', 'paused', 'done', 'failed', 'quarantined', 'cancelled')),
    priority      INTEGER NOT NULL DEFAULT 0,
    options       TEXT    NOT NULL,
    points        INTEGER NOT NULL,
    bytes         INTEGER NOT NULL,
    attempts      INTEGER NOT NULL DEFAULT 0,
    strikes       INTEGER NOT NULL DEFAULT 0,
    postponements INTEGER NOT NULL DEFAULT 0,
    not_before    INTEGER NOT NULL DEFAULT 0,
    hold          TEXT,                           -- why it does not start yet
    wish          TEXT    CHECK (wish IN ('cancel', 'pause')),
    error         TEXT,
    lease_owner   TEXT,                           -- which daemon run has it
    heartbeat_at  INTEGER,                        -- when its progress last moved
    staged        INTEGER NOT NULL DEFAULT 0,     -- inode of the converted octree, where only the publishing swap is left
    result        TEXT,
    superseded_by INTEGER REFERENCES job (id),
    created_at    INTEGER NOT NULL,
    started_at    INTEGER,
    updated_at    INTEGER NOT NULL,
    finished_at   INTEGER,
    CHECK ((state = 'running') = (lease_owner IS NOT NULL))
) STRICT;

-- The same content is never queued or converted twice at the same time, nor
-- again while its octree stands.
CREATE UNIQUE INDEX job_by_content ON job (content_key)
    WHERE state IN ('queued', 'running', 'paused') OR (state = 'done' AND superseded_by IS NULL);
CREATE INDEX job_ready ON job (priority DESC, id) WHERE state = 'queued';
CREATE INDEX job_by_state ON job (state);
CREATE INDEX job_by_data_set ON job (data_set);

CREATE TABLE job_input (
    job      INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    ord      INTEGER NOT NULL,
    path     TEXT    NOT NULL,
    size     INTEGER NOT NULL,
    mtime_ns INTEGER NOT NULL,
    hash     TEXT    NOT NULL,
    PRIMARY KEY (job, ord)
) STRICT;

CREATE TABLE attempt (
    job        INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    ord        INTEGER NOT NULL,                  -- counts every begun run, parked ones too
    owner      TEXT    NOT NULL,
    started_at INTEGER NOT NULL,
    ended_at   INTEGER,
    outcome    TEXT,                              -- the event that ended it
    error      TEXT,
    PRIMARY KEY (job, ord)
) STRICT;

CREATE TABLE event (
    id     INTEGER PRIMARY KEY,
    job    INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    at     INTEGER NOT NULL,
    kind   TEXT    NOT NULL,
    detail TEXT
) STRICT;
CREATE INDEX event_by_job ON event (job, id);
