-- Every new data set asks whether its name is taken, and every new octree what else has
-- its name: with a hundred thousand jobs that must not read all of them.
CREATE INDEX job_by_name ON job (lower(name));
CREATE INDEX data_set_by_name ON data_set (lower(name));
