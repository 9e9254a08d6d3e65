-- Verifications that were ordered on the page, with what they found: one for each
-- octree that stands.
CREATE TABLE verification (
    job      INTEGER PRIMARY KEY REFERENCES job (id) ON DELETE CASCADE,
    state    TEXT    NOT NULL CHECK (state IN ('queued', 'done', 'failed')),
    attempts INTEGER NOT NULL DEFAULT 0,        -- begun since it was ordered
    asked_at INTEGER NOT NULL,
    ended_at INTEGER,
    error    TEXT,                              -- why nothing could be verified
    report   TEXT                               -- what was found
) STRICT;
CREATE INDEX verification_due ON verification (asked_at) WHERE state = 'queued';

-- What was found of an octree says nothing of the one that replaces it.
CREATE TRIGGER verification_is_stale AFTER UPDATE OF state ON job
WHEN NEW.state <> OLD.state
BEGIN
    DELETE FROM verification WHERE job = NEW.id;
END;

-- Links to single octrees that need no token. The link itself is signed; the row
-- says that it still holds.
CREATE TABLE share (
    id         INTEGER PRIMARY KEY,
    name       TEXT    NOT NULL,                  -- the octree's
    created_at INTEGER NOT NULL,
    revoked_at INTEGER
) STRICT;
CREATE INDEX share_by_name ON share (name);
