-- What the page lists, filters, searches and sorts, with as many jobs as there
-- may be, and what a person orders there.

-- Failed or replaced jobs that somebody has taken note of; NULL is not yet.
ALTER TABLE job ADD COLUMN dismissed_at INTEGER;
-- The state as people are told it: an octree that another replaced is not "done".
ALTER TABLE job ADD COLUMN shown TEXT GENERATED ALWAYS AS (
    CASE WHEN dismissed_at IS NOT NULL THEN 'dismissed'
         WHEN state = 'done' AND superseded_by IS NOT NULL THEN 'replaced'
         ELSE state END) VIRTUAL;
-- How long its last run took, in milliseconds.
ALTER TABLE job ADD COLUMN took INTEGER GENERATED ALWAYS AS (finished_at - started_at) VIRTUAL;

-- All that is filtered and sorted by, in one narrow index: it is scanned in
-- milliseconds where the table, with its reports, would take seconds.
CREATE INDEX job_listed ON job (
    shown, id, name, bytes, points, took,
    state, dismissed_at, superseded_by, started_at, finished_at -- what the generated ones are made of
);

-- Whatever happens to a dismissed job is news again.
CREATE TRIGGER job_is_news AFTER UPDATE OF state ON job
WHEN NEW.dismissed_at IS NOT NULL AND NEW.state <> OLD.state
BEGIN
    UPDATE job SET dismissed_at = NULL WHERE id = NEW.id;
END;

-- What an operator set for the whole daemon, as whether new jobs are started.
CREATE TABLE setting (
    key   TEXT PRIMARY KEY,
    value TEXT NOT NULL
) STRICT;

-- The log's lines about a job; the oldest go.
CREATE TABLE log_line (
    id    INTEGER PRIMARY KEY,
    job   INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    at    INTEGER NOT NULL,
    level TEXT    NOT NULL,
    text  TEXT    NOT NULL
) STRICT;
CREATE INDEX log_line_by_job ON log_line (job, id);
