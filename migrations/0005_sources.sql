-- What may be done with sources, and with what stands under an octree's name.

-- What tells the job's octree from anything else under its name; NULL where an
-- earlier version published it.
ALTER TABLE job ADD COLUMN octree TEXT;
-- Why its sources are never put away, where there is doubt about them.
ALTER TABLE job ADD COLUMN doubt TEXT;
-- Why it cannot be converted as it was meant to be.
ALTER TABLE job ADD COLUMN refusal TEXT;

-- The file's number and its time of change; zero where they are not known.
ALTER TABLE job_input ADD COLUMN inode INTEGER NOT NULL DEFAULT 0;
ALTER TABLE job_input ADD COLUMN ctime_ns INTEGER NOT NULL DEFAULT 0;
