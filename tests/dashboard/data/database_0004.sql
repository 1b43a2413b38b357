BEGIN TRANSACTION;
CREATE TABLE alembic_version (
	version_num VARCHAR(32) NOT NULL, 
	CONSTRAINT alembic_version_pkc PRIMARY KEY (version_num)
);
INSERT INTO "alembic_version" VALUES('0004');
CREATE TABLE cycles (
	cycle BIGINT NOT NULL, 
	started_ns BIGINT NOT NULL, 
	wall_s DOUBLE NOT NULL, 
	status VARCHAR NOT NULL, 
	reason VARCHAR, 
	solver VARCHAR, 
	objective_kwh DOUBLE, 
	variables BIGINT NOT NULL, 
	plan_count BIGINT NOT NULL, 
	baseline VARCHAR, 
	baseline_kwh DOUBLE, 
	cooperative_kwh DOUBLE, 
	saved_distance_kwh DOUBLE, 
	saved_drag_kwh DOUBLE, 
	saved_acceleration_kwh DOUBLE, 
	platooned_distance_m DOUBLE, unserved JSON DEFAULT '[]' NOT NULL, 
	CONSTRAINT pk_cycles PRIMARY KEY (cycle)
);
INSERT INTO "cycles" VALUES(1,1794999940000000000,1.62,'ok',NULL,'exact',1.583,25,2,'each van alone on its cheapest route',1.72635973483980764697e+00,1.65535973483980769493e+00,0.0,0.071,0.0,3992.0,'[]');
INSERT INTO "cycles" VALUES(2,1794999970000000000,1.62,'ok',NULL,'exact',1.583,25,2,'each van alone on its cheapest route',1.74091849015348687501e+00,1.66991849015348692297e+00,0.0,0.071,0.0,3992.0,'[]');
INSERT INTO "cycles" VALUES(3,1795000000000000000,1.62,'ok',NULL,'exact',1.583,25,2,'each van alone on its cheapest route',1.752073549240394712e+00,1.68107354924039475996e+00,0.0,0.071,0.0,3992.0,'[]');
CREATE TABLE gates (
	cycle BIGINT NOT NULL, 
	position BIGINT NOT NULL, 
	segment VARCHAR NOT NULL, 
	y_e BIGINT, 
	reason VARCHAR, 
	age_s DOUBLE, 
	speed_mps DOUBLE, 
	open BOOLEAN NOT NULL, 
	CONSTRAINT pk_gates PRIMARY KEY (cycle, position), 
	CONSTRAINT fk_gates_cycle_cycles FOREIGN KEY(cycle) REFERENCES cycles (cycle) ON DELETE CASCADE
);
INSERT INTO "gates" VALUES(1,0,'avenue_east',1,NULL,0.6,15.0,1);
INSERT INTO "gates" VALUES(1,1,'avenue_west',0,'turbulent',0.8,7.0,0);
INSERT INTO "gates" VALUES(2,0,'avenue_east',1,NULL,0.6,15.0,1);
INSERT INTO "gates" VALUES(2,1,'avenue_west',0,'turbulent',0.8,7.0,0);
INSERT INTO "gates" VALUES(3,0,'avenue_east',1,NULL,0.6,15.0,1);
INSERT INTO "gates" VALUES(3,1,'avenue_west',0,'turbulent',0.8,7.0,0);
CREATE TABLE plans (
	cycle BIGINT NOT NULL, 
	vehicle VARCHAR NOT NULL, 
	issued_ns BIGINT NOT NULL, 
	valid_until_ns BIGINT NOT NULL, 
	depart_ns BIGINT NOT NULL, 
	distance_m DOUBLE NOT NULL, 
	energy_kwh DOUBLE NOT NULL, 
	stops JSON NOT NULL, 
	segments JSON NOT NULL, advice JSON DEFAULT '{}' NOT NULL, 
	CONSTRAINT pk_plans PRIMARY KEY (cycle, vehicle), 
	CONSTRAINT fk_plans_cycle_cycles FOREIGN KEY(cycle) REFERENCES cycles (cycle) ON DELETE CASCADE
);
INSERT INTO "plans" VALUES(1,'van-a',1794999940000000000,1795000840000000000,1794999950000000000,7.35587000000000080027e+03,0.86799266,'[{"stop": "c2", "node": "c2", "arrival_ns": 1795000020161987041, "departure_ns": 1795000050161987041}, {"stop": "c1", "node": "c1", "arrival_ns": 1795000228307808848, "departure_ns": 1795000258307808848}]','[{"segment": "depot_road_east", "entry_ns": 1794999950000000000, "exit_ns": 1794999985632109431, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 0}, {"segment": "mill_street_east", "entry_ns": 1794999985632109431, "exit_ns": 1795000020161987041, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 0}, {"segment": "mill_link_east", "entry_ns": 1795000050161987041, "exit_ns": 1795000079162706983, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 1}, {"segment": "avenue_east", "entry_ns": 1795000079162706983, "exit_ns": 1795000198883762772, "speed_mps": 16.67, "platoon": "east-1", "place": 0, "gap_m": null, "leg": 1}, {"segment": "hill_link_east", "entry_ns": 1795000198883762772, "exit_ns": 1795000228307808848, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 1}, {"segment": "hill_link_west", "entry_ns": 1795000258307808848, "exit_ns": 1795000287731854924, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 2}, {"segment": "avenue_west", "entry_ns": 1795000287731854924, "exit_ns": 1795000407452910713, "speed_mps": 16.67, "platoon": null, "place": null, "gap_m": null, "leg": 2}, {"segment": "gate_west", "entry_ns": 1795000407452910713, "exit_ns": 1795000456025264925, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 2}, {"segment": "depot_road_west", "entry_ns": 1795000456025264925, "exit_ns": 1795000491657374356, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 2}]','{"eco_approach": false, "coasting_budget": 0.0, "signal_priority": false, "departure_window_s": 0.0}');
INSERT INTO "plans" VALUES(1,'van-b',1794999940000000000,1795000840000000000,1794999950000000000,7355.75,0.8679785,'[{"stop": "c4", "node": "c4", "arrival_ns": 1795000020161987041, "departure_ns": 1795000050161987041}, {"stop": "c3", "node": "c3", "arrival_ns": 1795000228302049310, "departure_ns": 1795000258302049310}]','[{"segment": "depot_road_east", "entry_ns": 1794999950000000000, "exit_ns": 1794999985632109431, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 0}, {"segment": "dock_street_east", "entry_ns": 1794999985632109431, "exit_ns": 1795000020161987041, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 0}, {"segment": "dock_link_east", "entry_ns": 1795000050161987041, "exit_ns": 1795000079159827214, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 1}, {"segment": "avenue_east", "entry_ns": 1795000079159827214, "exit_ns": 1795000198880883003, "speed_mps": 16.67, "platoon": "east-1", "place": 1, "gap_m": 8.0, "leg": 1}, {"segment": "quay_link_east", "entry_ns": 1795000198880883003, "exit_ns": 1795000228302049310, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 1}, {"segment": "quay_link_west", "entry_ns": 1795000258302049310, "exit_ns": 1795000287723215617, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 2}, {"segment": "avenue_west", "entry_ns": 1795000287723215617, "exit_ns": 1795000407444271406, "speed_mps": 16.67, "platoon": null, "place": null, "gap_m": null, "leg": 2}, {"segment": "gate_west", "entry_ns": 1795000407444271406, "exit_ns": 1795000456016625618, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 2}, {"segment": "depot_road_west", "entry_ns": 1795000456016625618, "exit_ns": 1795000491648735049, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 2}]','{"eco_approach": false, "coasting_budget": 0.0, "signal_priority": false, "departure_window_s": 0.0}');
INSERT INTO "plans" VALUES(2,'van-a',1794999970000000000,1795000870000000000,1794999980000000000,7.35587000000000080027e+03,0.86799266,'[{"stop": "c2", "node": "c2", "arrival_ns": 1795000050161987041, "departure_ns": 1795000080161987041}, {"stop": "c1", "node": "c1", "arrival_ns": 1795000258307808848, "departure_ns": 1795000288307808848}]','[{"segment": "depot_road_east", "entry_ns": 1794999980000000000, "exit_ns": 1795000015632109431, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 0}, {"segment": "mill_street_east", "entry_ns": 1795000015632109431, "exit_ns": 1795000050161987041, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 0}, {"segment": "mill_link_east", "entry_ns": 1795000080161987041, "exit_ns": 1795000109162706983, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 1}, {"segment": "avenue_east", "entry_ns": 1795000109162706983, "exit_ns": 1795000228883762772, "speed_mps": 16.67, "platoon": "east-1", "place": 0, "gap_m": null, "leg": 1}, {"segment": "hill_link_east", "entry_ns": 1795000228883762772, "exit_ns": 1795000258307808848, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 1}, {"segment": "hill_link_west", "entry_ns": 1795000288307808848, "exit_ns": 1795000317731854924, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 2}, {"segment": "avenue_west", "entry_ns": 1795000317731854924, "exit_ns": 1795000437452910713, "speed_mps": 16.67, "platoon": null, "place": null, "gap_m": null, "leg": 2}, {"segment": "gate_west", "entry_ns": 1795000437452910713, "exit_ns": 1795000486025264925, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 2}, {"segment": "depot_road_west", "entry_ns": 1795000486025264925, "exit_ns": 1795000521657374356, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 2}]','{"eco_approach": false, "coasting_budget": 0.0, "signal_priority": false, "departure_window_s": 0.0}');
INSERT INTO "plans" VALUES(2,'van-b',1794999970000000000,1795000870000000000,1794999980000000000,7355.75,0.8679785,'[{"stop": "c4", "node": "c4", "arrival_ns": 1795000050161987041, "departure_ns": 1795000080161987041}, {"stop": "c3", "node": "c3", "arrival_ns": 1795000258302049310, "departure_ns": 1795000288302049310}]','[{"segment": "depot_road_east", "entry_ns": 1794999980000000000, "exit_ns": 1795000015632109431, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 0}, {"segment": "dock_street_east", "entry_ns": 1795000015632109431, "exit_ns": 1795000050161987041, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 0}, {"segment": "dock_link_east", "entry_ns": 1795000080161987041, "exit_ns": 1795000109159827214, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 1}, {"segment": "avenue_east", "entry_ns": 1795000109159827214, "exit_ns": 1795000228880883003, "speed_mps": 16.67, "platoon": "east-1", "place": 1, "gap_m": 8.0, "leg": 1}, {"segment": "quay_link_east", "entry_ns": 1795000228880883003, "exit_ns": 1795000258302049310, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 1}, {"segment": "quay_link_west", "entry_ns": 1795000288302049310, "exit_ns": 1795000317723215617, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 2}, {"segment": "avenue_west", "entry_ns": 1795000317723215617, "exit_ns": 1795000437444271406, "speed_mps": 16.67, "platoon": null, "place": null, "gap_m": null, "leg": 2}, {"segment": "gate_west", "entry_ns": 1795000437444271406, "exit_ns": 1795000486016625618, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 2}, {"segment": "depot_road_west", "entry_ns": 1795000486016625618, "exit_ns": 1795000521648735049, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 2}]','{"eco_approach": false, "coasting_budget": 0.0, "signal_priority": false, "departure_window_s": 0.0}');
INSERT INTO "plans" VALUES(3,'van-a',1795000000000000000,1795000900000000000,1795000010000000000,7.35587000000000080027e+03,0.86799266,'[{"stop": "c2", "node": "c2", "arrival_ns": 1795000080161987041, "departure_ns": 1795000110161987041}, {"stop": "c1", "node": "c1", "arrival_ns": 1795000288307808848, "departure_ns": 1795000318307808848}]','[{"segment": "depot_road_east", "entry_ns": 1795000010000000000, "exit_ns": 1795000045632109431, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 0}, {"segment": "mill_street_east", "entry_ns": 1795000045632109431, "exit_ns": 1795000080161987041, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 0}, {"segment": "mill_link_east", "entry_ns": 1795000110161987041, "exit_ns": 1795000139162706983, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 1}, {"segment": "avenue_east", "entry_ns": 1795000139162706983, "exit_ns": 1795000258883762772, "speed_mps": 16.67, "platoon": "east-1", "place": 0, "gap_m": null, "leg": 1}, {"segment": "hill_link_east", "entry_ns": 1795000258883762772, "exit_ns": 1795000288307808848, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 1}, {"segment": "hill_link_west", "entry_ns": 1795000318307808848, "exit_ns": 1795000347731854924, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 2}, {"segment": "avenue_west", "entry_ns": 1795000347731854924, "exit_ns": 1795000467452910713, "speed_mps": 16.67, "platoon": null, "place": null, "gap_m": null, "leg": 2}, {"segment": "gate_west", "entry_ns": 1795000467452910713, "exit_ns": 1795000516025264925, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 2}, {"segment": "depot_road_west", "entry_ns": 1795000516025264925, "exit_ns": 1795000551657374356, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 2}]','{"eco_approach": false, "coasting_budget": 0.0, "signal_priority": false, "departure_window_s": 0.0}');
INSERT INTO "plans" VALUES(3,'van-b',1795000000000000000,1795000900000000000,1795000010000000000,7355.75,0.8679785,'[{"stop": "c4", "node": "c4", "arrival_ns": 1795000080161987041, "departure_ns": 1795000110161987041}, {"stop": "c3", "node": "c3", "arrival_ns": 1795000288302049310, "departure_ns": 1795000318302049310}]','[{"segment": "depot_road_east", "entry_ns": 1795000010000000000, "exit_ns": 1795000045632109431, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 0}, {"segment": "dock_street_east", "entry_ns": 1795000045632109431, "exit_ns": 1795000080161987041, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 0}, {"segment": "dock_link_east", "entry_ns": 1795000110161987041, "exit_ns": 1795000139159827214, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 1}, {"segment": "avenue_east", "entry_ns": 1795000139159827214, "exit_ns": 1795000258880883003, "speed_mps": 16.67, "platoon": "east-1", "place": 1, "gap_m": 8.0, "leg": 1}, {"segment": "quay_link_east", "entry_ns": 1795000258880883003, "exit_ns": 1795000288302049310, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 1}, {"segment": "quay_link_west", "entry_ns": 1795000318302049310, "exit_ns": 1795000347723215617, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 2}, {"segment": "avenue_west", "entry_ns": 1795000347723215617, "exit_ns": 1795000467444271406, "speed_mps": 16.67, "platoon": null, "place": null, "gap_m": null, "leg": 2}, {"segment": "gate_west", "entry_ns": 1795000467444271406, "exit_ns": 1795000516016625618, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 2}, {"segment": "depot_road_west", "entry_ns": 1795000516016625618, "exit_ns": 1795000551648735049, "speed_mps": 13.89, "platoon": null, "place": null, "gap_m": null, "leg": 2}]','{"eco_approach": false, "coasting_budget": 0.0, "signal_priority": false, "departure_window_s": 0.0}');
CREATE TABLE quantum_jobs (
	tag VARCHAR NOT NULL, 
	job_id VARCHAR, 
	backend VARCHAR NOT NULL, 
	kind VARCHAR NOT NULL, 
	cycle BIGINT NOT NULL, 
	submitted_ns BIGINT NOT NULL, 
	updated_ns BIGINT NOT NULL, 
	finished_ns BIGINT, 
	state VARCHAR NOT NULL, 
	reason VARCHAR, 
	estimate_s DOUBLE NOT NULL, 
	usage_s DOUBLE, 
	shots BIGINT NOT NULL, 
	circuit VARCHAR NOT NULL, 
	variables VARCHAR NOT NULL, 
	chain_order JSON NOT NULL, 
	variant VARCHAR NOT NULL, 
	layers BIGINT NOT NULL, 
	two_qubit_depth BIGINT, 
	two_qubit_gates BIGINT, 
	train_s DOUBLE NOT NULL, 
	answer VARCHAR, 
	answer_cycle BIGINT, 
	CONSTRAINT pk_quantum_jobs PRIMARY KEY (tag)
);
INSERT INTO "quantum_jobs" VALUES('t1','j1','ibm:boston','hardware',2,1794999960000000000,1794999980000000000,1794999980000000000,'done',NULL,2.0,1.5,4096,'c','v','[1, 0, 2]','lc',1,8,24,0.5,'used',3);
CREATE TABLE segment_states (
	cycle BIGINT NOT NULL, 
	segment VARCHAR NOT NULL, 
	rsu VARCHAR NOT NULL, 
	sequence BIGINT NOT NULL, 
	time_ns BIGINT NOT NULL, 
	window_s DOUBLE NOT NULL, 
	y_e BIGINT, 
	reason VARCHAR, 
	vehicles BIGINT NOT NULL, 
	frames BIGINT NOT NULL, 
	coverage DOUBLE NOT NULL, 
	features JSON, 
	CONSTRAINT pk_segment_states PRIMARY KEY (cycle, segment, rsu), 
	CONSTRAINT fk_segment_states_cycle_cycles FOREIGN KEY(cycle) REFERENCES cycles (cycle) ON DELETE CASCADE
);
INSERT INTO "segment_states" VALUES(1,'avenue_east','rsu-avenue_east',1794999940,1794999940000000000,10.0,1,NULL,9,300,1.0,'{"mean_speed_mps": {"value": 15.0, "standard_error": 0.1}, "mean_acceleration_mps2": {"value": 0.01, "standard_error": null}, "density_veh_per_m": {"value": 0.03, "standard_error": null}, "speed_std_mps": {"value": 0.75, "standard_error": null}, "acceleration_variance_m2ps4": {"value": 0.08, "standard_error": null}, "mean_gap_m": null}');
INSERT INTO "segment_states" VALUES(1,'avenue_west','rsu-avenue_west',1794999940,1794999940000000000,10.0,0,NULL,9,300,1.0,'{"mean_speed_mps": {"value": 15.0, "standard_error": 0.1}, "mean_acceleration_mps2": {"value": 0.01, "standard_error": null}, "density_veh_per_m": {"value": 0.03, "standard_error": null}, "speed_std_mps": {"value": 5.25, "standard_error": null}, "acceleration_variance_m2ps4": {"value": 1.4, "standard_error": null}, "mean_gap_m": null}');
INSERT INTO "segment_states" VALUES(2,'avenue_east','rsu-avenue_east',1794999970,1794999970000000000,10.0,1,NULL,9,300,1.0,'{"mean_speed_mps": {"value": 15.0, "standard_error": 0.1}, "mean_acceleration_mps2": {"value": 0.01, "standard_error": null}, "density_veh_per_m": {"value": 0.03, "standard_error": null}, "speed_std_mps": {"value": 0.75, "standard_error": null}, "acceleration_variance_m2ps4": {"value": 0.08, "standard_error": null}, "mean_gap_m": null}');
INSERT INTO "segment_states" VALUES(2,'avenue_west','rsu-avenue_west',1794999970,1794999970000000000,10.0,0,NULL,9,300,1.0,'{"mean_speed_mps": {"value": 15.0, "standard_error": 0.1}, "mean_acceleration_mps2": {"value": 0.01, "standard_error": null}, "density_veh_per_m": {"value": 0.03, "standard_error": null}, "speed_std_mps": {"value": 5.25, "standard_error": null}, "acceleration_variance_m2ps4": {"value": 1.4, "standard_error": null}, "mean_gap_m": null}');
INSERT INTO "segment_states" VALUES(3,'avenue_east','rsu-avenue_east',1795000000,1795000000000000000,10.0,1,NULL,9,300,1.0,'{"mean_speed_mps": {"value": 15.0, "standard_error": 0.1}, "mean_acceleration_mps2": {"value": 0.01, "standard_error": null}, "density_veh_per_m": {"value": 0.03, "standard_error": null}, "speed_std_mps": {"value": 0.75, "standard_error": null}, "acceleration_variance_m2ps4": {"value": 0.08, "standard_error": null}, "mean_gap_m": null}');
INSERT INTO "segment_states" VALUES(3,'avenue_west','rsu-avenue_west',1795000000,1795000000000000000,10.0,0,NULL,9,300,1.0,'{"mean_speed_mps": {"value": 15.0, "standard_error": 0.1}, "mean_acceleration_mps2": {"value": 0.01, "standard_error": null}, "density_veh_per_m": {"value": 0.03, "standard_error": null}, "speed_std_mps": {"value": 5.25, "standard_error": null}, "acceleration_variance_m2ps4": {"value": 1.4, "standard_error": null}, "mean_gap_m": null}');
CREATE TABLE solver_runs (
	cycle BIGINT NOT NULL, 
	position BIGINT NOT NULL, 
	solver VARCHAR NOT NULL, 
	status VARCHAR NOT NULL, 
	objective_kwh DOUBLE, 
	repaired BOOLEAN NOT NULL, 
	p_feasible_raw DOUBLE, 
	p_optimal_raw DOUBLE, 
	p_feasible_repaired DOUBLE, 
	qubits BIGINT, 
	shots BIGINT, 
	wall_s DOUBLE NOT NULL, 
	reason VARCHAR, backend VARCHAR, backend_kind VARCHAR, fallback VARCHAR, two_qubit_depth BIGINT, 
	CONSTRAINT pk_solver_runs PRIMARY KEY (cycle, position), 
	CONSTRAINT fk_solver_runs_cycle_cycles FOREIGN KEY(cycle) REFERENCES cycles (cycle) ON DELETE CASCADE
);
INSERT INTO "solver_runs" VALUES(1,0,'exact','optimal',1.583,0,NULL,NULL,NULL,NULL,NULL,0.31,NULL,NULL,NULL,NULL,NULL);
INSERT INTO "solver_runs" VALUES(1,1,'lc-qaoa','feasible',1.583,1,0.00024,0.0,1.0,25,4096,0.84,NULL,'aer','simulated','job c1 still queued after 8.0 s',8);
INSERT INTO "solver_runs" VALUES(2,0,'exact','optimal',1.583,0,NULL,NULL,NULL,NULL,NULL,0.31,NULL,NULL,NULL,NULL,NULL);
INSERT INTO "solver_runs" VALUES(2,1,'lc-qaoa','feasible',1.583,1,0.00024,0.0,1.0,25,4096,0.84,NULL,'aer','simulated','job c1 still queued after 8.0 s',8);
INSERT INTO "solver_runs" VALUES(3,0,'exact','optimal',1.583,0,NULL,NULL,NULL,NULL,NULL,0.31,NULL,NULL,NULL,NULL,NULL);
INSERT INTO "solver_runs" VALUES(3,1,'lc-qaoa','feasible',1.583,1,0.00024,0.0,1.0,25,4096,0.84,NULL,'aer','simulated','job c1 still queued after 8.0 s',8);
CREATE INDEX ix_cycles_started_ns ON cycles (started_ns);
CREATE INDEX ix_quantum_jobs_submitted_ns ON quantum_jobs (submitted_ns);
COMMIT;
