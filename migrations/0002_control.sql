-- What follows from a job's end, owed until it is done: a crash in between
-- leaves the debt, and the next start pays it.

-- What is still to be done with the sources of a published data set. Written
-- before publishing; it counts once the job is done.
ALTER TABLE job ADD COLUMN sources TEXT CHECK (sources IN ('move', 'delete'));
-- Where they went, where they were moved; empty where they were removed.
ALTER TABLE job ADD COLUMN sources_now TEXT;
-- The end of which a hook is still to be told.
ALTER TABLE job ADD COLUMN hook TEXT CHECK (hook IN ('done', 'failed', 'quarantined'));

CREATE INDEX job_owing_sources ON job (id) WHERE sources IS NOT NULL;
CREATE INDEX job_owing_hook ON job (id) WHERE hook IS NOT NULL;
-- Old jobs are removed; these are who may still speak of them.
CREATE INDEX job_by_successor ON job (superseded_by) WHERE superseded_by IS NOT NULL;
CREATE INDEX data_set_by_job ON data_set (job) WHERE job IS NOT NULL;
CREATE INDEX job_by_end ON job (finished_at) WHERE finished_at IS NOT NULL;
