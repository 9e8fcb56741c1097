{{ (("Electronic throttle body: " ~ title, "") + notes) | c_comment }}

/*
 * Everything is SI. One thread a plant; nothing is allocated.
 *
 *     etcfit_plant plant;
 *     etcfit_plant_output seen;
 *     etcfit_plant_init(&plant, &etcfit_plant_fitted, 0.0);
 *     for (;;) {
 *         const etcfit_plant_input drive = {6.0, 0.0};
 *         etcfit_plant_step(&plant, &drive, &seen);
 *     }
 */
#ifndef ETCFIT_PLANT_H
#define ETCFIT_PLANT_H

#ifdef __cplusplus
extern "C" {
#endif

#define ETCFIT_PLANT_STEP {{ plant.step | number }} /* s, the time that etcfit_plant_step takes further */
{% if plant.late %}
#define ETCFIT_PLANT_LATEST {{ plant.late.room - 2 }} /* steps, the longest delay */
{% endif %}

typedef struct etcfit_plant_parameters {
{% for q in plant.quantities %}
    double {{ q.symbol }}; /* {{ q.unit }}: {{ q.meaning | in_c }} */
{% endfor %}
} etcfit_plant_parameters;

/* as fitted */
extern const etcfit_plant_parameters etcfit_plant_fitted;

typedef struct etcfit_plant_input {
    double voltage; /* V at the terminals, constant over the step */
    double torque;  /* N m at the plate besides the motor's, through the gear like it; positive opens */
} etcfit_plant_input;

typedef struct etcfit_plant_output {
    double angle;          /* rad, of the plate */
    double speed;          /* rad/s, of the plate */
    double current;        /* A, in the armature */
    double sensor_angle;   /* rad, what the position sensor shows */
    double sensor_current; /* A, what the current sensor shows */
{% if plant.sensor %}
    double sensor_voltage; /* V, of the position sensor */
{% endif %}
} etcfit_plant_output;

typedef struct etcfit_plant {
    etcfit_plant_parameters parameters; /* may be changed between steps */
    double time;                        /* s, since the begin */
    double i;                           /* A */
    double theta;                       /* rad */
    double omega;                       /* rad/s */
    double voltage;                     /* V, that acted in the last step */
    double torque;                      /* N m, that acted in the last step */
{% for memory in plant.memories %}
    double z{{ loop.index0 }}; /* memory of {{ memory.effect }} */
{% endfor %}
{% if plant.late %}
    unsigned newest; /* place of the newest sample in the delay lines */
{% if plant.late.lines[0] %}
    double late_voltage[{{ plant.late.room }}];
{% endif %}
{% if plant.late.lines[1] %}
    double late_angle[{{ plant.late.room }}];
{% endif %}
{% if plant.late.lines[2] %}
    double late_current[{{ plant.late.room }}];
{% endif %}
{% endif %}
} etcfit_plant;

/* A plate at rest at an angle (rad), moved to the nearest stop if it lies beyond; no current. */
void etcfit_plant_init(etcfit_plant *plant, const etcfit_plant_parameters *parameters, double angle);

/* One step of ETCFIT_PLANT_STEP; seen may be a null pointer. */
void etcfit_plant_step(etcfit_plant *plant, const etcfit_plant_input *drive, etcfit_plant_output *seen);

/* What the sensors show now. */
void etcfit_plant_read(const etcfit_plant *plant, etcfit_plant_output *seen);

#ifdef __cplusplus
}
#endif

#endif
