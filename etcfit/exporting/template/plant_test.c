/*
 * Whether this compiler and this machine compute what etcfit computed: exit status 0 if they do.
 *
 *     cc -std=c99 -O2 etcfit_plant.c etcfit_plant_test.c -lm -o etcfit_plant_test && ./etcfit_plant_test
 */
#include "etcfit_plant.h"

#include <math.h>
#include <stdio.h>

typedef struct row {
    double voltage; /* V, over the steps that end with this row */
    double i, theta, omega;
} row;

enum { ROWS = {{ rows | length }}, STEPS = {{ steps }} }; /* steps in a row */

/* from etcfit's own stepper */
static const row expected[ROWS] = {
{% for row in rows %}
    { {{- row | map("number") | join(", ") -}} },
{% endfor %}
};

static int near(double found, double wanted, double scale)
{
    return fabs(found - wanted) <= 1e-6 * scale;
}

int main(void)
{
    etcfit_plant plant;
    etcfit_plant_output seen;
    int k, n, wrong = 0;
    etcfit_plant_init(&plant, &etcfit_plant_fitted, {{ start | number }});
    for (k = 0; k < ROWS; k++) {
        const etcfit_plant_input drive = {expected[k].voltage, 0.0};
        for (n = 0; n < STEPS; n++) {
            etcfit_plant_step(&plant, &drive, &seen);
        }
        if (!near(seen.current, expected[k].i, 10.0) || !near(seen.angle, expected[k].theta, 1.0) ||
            !near(seen.speed, expected[k].omega, 100.0)) {
            wrong++;
        }
        printf("%.6f s  %8.4f V  %10.6f A  %10.7f rad  %11.6f rad/s\n", plant.time, drive.voltage, seen.current,
               seen.angle, seen.speed);
    }
    printf(wrong ? "WRONG: %d of %d rows differ from etcfit\n" : "%d of %d rows differ from etcfit\n", wrong, (int)ROWS);
    return wrong ? 1 : 0;
}
