{{ ["Electronic throttle body: " ~ title] | c_comment }}

/*
 * Printed from the traced Python of etcfit: do not edit, export again. a17 is a quantity, c18 a condition.
 * Method: two-stage L-stable SDIRK, dry friction as a set-valued law solved exactly inside each implicit stage
 * (Alexander 1977; Acary and Brogliato 2008, ch. 1), so that a sticking plate stands still.
 */
#include "etcfit_plant.h"

#include <math.h>
#include <stddef.h>

{% macro local(program) %}
{% for name in plant.names + ("voltage", "torque", "time") if name in program.inputs %}
    const double {{ name }} = plant->{{ name }};
{% endfor %}
{% endmacro %}
{% macro uses(program) %}
{%- for name in program.inputs if name.startswith("p->") %}{% if loop.first %}
    const etcfit_plant_parameters *const p = &plant->parameters;
{% endif %}{% endfor %}
{% endmacro %}
{% macro lines(program) %}
{% for line in program.lines %}
    {{ line }}
{% endfor %}
{% endmacro %}
const etcfit_plant_parameters etcfit_plant_fitted = {
{% for q in plant.quantities %}
    {{ q.value | number }}, /* {{ q.symbol }} */
{% endfor %}
};

{% if "sign" in plant.calls %}
static double sign(double a)
{
    return (double)((a > 0.0) - (a < 0.0));
}

{% endif %}
{% if plant.late %}
#define ROOM {{ plant.late.room }}u

/* A sample so many steps ago, linear between samples. */
static double ago(const double *line, unsigned newest, double steps)
{
    const double within = fmin(fmax(steps, 0.0), (double)ETCFIT_PLANT_LATEST);
    const unsigned n = (unsigned)within;
    const double share = within - (double)n;
    const double late = line[(newest + ROOM - n) % ROOM];
    return late + share * (line[(newest + ROOM - n - 1u) % ROOM] - late);
}

typedef struct {
    double voltage, angle, current; /* steps */
} lateness;

static lateness lateness_of(const etcfit_plant *plant)
{
    lateness late;
{{ uses(plant.late.program) }}{{ lines(plant.late.program) }}    late.voltage = {{ plant.late.program.results[0] }};
    late.angle = {{ plant.late.program.results[1] }};
    late.current = {{ plant.late.program.results[2] }};
    return late;
}

{% endif %}
/* What the sensors show, late or not. */
static void sensed(const etcfit_plant *plant, double *angle, double *current)
{
{{ uses(plant.read) }}{{ local(plant.read) }}{{ lines(plant.read) }}    *angle = {{ plant.read.results[0] }};
    *current = {{ plant.read.results[1] }};
}

static void advance(etcfit_plant *plant)
{
{{ uses(plant.advance) }}{{ local(plant.advance) }}{{ lines(plant.advance) }}{% for name in plant.names %}
    plant->{{ name }} = {{ plant.advance.results[loop.index0] }};
{% endfor %}
}

void etcfit_plant_init(etcfit_plant *plant, const etcfit_plant_parameters *parameters, double angle)
{
{% if plant.late %}
    unsigned k;
    double shown, current;
{% endif %}
    plant->parameters = *parameters;
    plant->time = 0.0;
    plant->i = 0.0;
    plant->theta = fmin(fmax(angle, parameters->lower), parameters->upper);
    plant->omega = 0.0;
    plant->voltage = 0.0;
    plant->torque = 0.0;
{% for memory in plant.memories %}
    plant->z{{ loop.index0 }} = {{ memory.start | number }};
{% endfor %}
{% if plant.late %}
    plant->newest = 0u;
    sensed(plant, &shown, &current);
    for (k = 0u; k < ROOM; k++) {
{% if plant.late.lines[0] %}
        plant->late_voltage[k] = 0.0;
{% endif %}
{% if plant.late.lines[1] %}
        plant->late_angle[k] = shown;
{% endif %}
{% if plant.late.lines[2] %}
        plant->late_current[k] = current;
{% endif %}
    }
    (void)shown;
    (void)current;
{% endif %}
}

void etcfit_plant_step(etcfit_plant *plant, const etcfit_plant_input *drive, etcfit_plant_output *seen)
{
{% if plant.late and (plant.late.lines[1] or plant.late.lines[2]) %}
    double shown, current;
{% endif %}
{% if plant.late %}
    plant->newest = (plant->newest + 1u) % ROOM;
{% endif %}
{% if plant.late and plant.late.lines[0] %}
    plant->late_voltage[plant->newest] = drive->voltage;
    plant->voltage = ago(plant->late_voltage, plant->newest, lateness_of(plant).voltage);
{% else %}
    plant->voltage = drive->voltage;
{% endif %}
    plant->torque = drive->torque;
    advance(plant);
    plant->time += ETCFIT_PLANT_STEP;
{% if plant.late and (plant.late.lines[1] or plant.late.lines[2]) %}
    sensed(plant, &shown, &current);
{% if plant.late.lines[1] %}
    plant->late_angle[plant->newest] = shown;
{% endif %}
{% if plant.late.lines[2] %}
    plant->late_current[plant->newest] = current;
{% endif %}
{% endif %}
    if (seen != NULL) {
        etcfit_plant_read(plant, seen);
    }
}

void etcfit_plant_read(const etcfit_plant *plant, etcfit_plant_output *seen)
{
    seen->angle = plant->theta;
    seen->speed = plant->omega;
    seen->current = plant->i;
    sensed(plant, &seen->sensor_angle, &seen->sensor_current);
{% if plant.late and plant.late.lines[1] %}
    seen->sensor_angle = ago(plant->late_angle, plant->newest, lateness_of(plant).angle);
{% endif %}
{% if plant.late and plant.late.lines[2] %}
    seen->sensor_current = ago(plant->late_current, plant->newest, lateness_of(plant).current);
{% endif %}
{% if plant.sensor %}
    seen->sensor_voltage = plant->parameters.sensor_closed_V + plant->parameters.sensor_slope * seen->sensor_angle;
{% endif %}
}
