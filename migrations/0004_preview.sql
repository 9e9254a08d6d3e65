-- Pictures of the octrees that stand: owed from the moment an octree is
-- published, with what became of it. The row goes with its job, and when the
-- octree is replaced.
CREATE TABLE preview (
    job        INTEGER PRIMARY KEY REFERENCES job (id) ON DELETE CASCADE,
    state      TEXT    NOT NULL CHECK (state IN ('queued', 'done', 'nothing', 'failed')),
    attempts   INTEGER NOT NULL DEFAULT 0,        -- begun since it was owed
    not_before INTEGER NOT NULL DEFAULT 0,
    error      TEXT,                              -- why there are none, or none yet
    receipt    TEXT,                              -- what there is: its preview.json
    updated_at INTEGER NOT NULL
) STRICT;

-- The youngest first: somebody may be waiting for it.
CREATE INDEX preview_owed ON preview (attempts, job DESC) WHERE state = 'queued';

-- Octrees of before are owed theirs too.
INSERT INTO preview (job, state, updated_at)
SELECT id, 'queued', updated_at FROM job WHERE state = 'done' AND superseded_by IS NULL;
