/* The engine of Lee (1995) with two states, integrated by a fixed-step fourth-order Runge-Kutta method: the peer against
   which the speed of revline's simulation is measured.

   Usage: engine_rk4 VECTOR STEP STEPS THROTTLE AMPLITUDE OMEGA PRESSURE SPEED

   VECTOR is a file of the 24 parameters in the order of Lee (1995). The throttle is THROTTLE + AMPLITUDE sin(OMEGA t) in
   degrees, evaluated at every stage. The history before t = 0 is the state (PRESSURE, SPEED) with the throttle held. Both
   delayed signals are read by cubic Lagrange interpolation through four samples, none of them across t = 0; the lag is
   taken from the present speed at each stage. Prints time, pressure, speed and nanoseconds per step.
   Status 2: wrong arguments; 1: a lag that is no longer than three steps or longer than the history, or a stalled engine. */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define COUNT 24
#define RADIANS (M_PI / 180.0)
#define AMBIENT_PRESSURE 100.0
#define PRESSURE_EXPONENT 9.0
#define GAS_CONSTANT (8.31434 / 28.84)
#define AIR_FUEL_RATIO 15.0
#define SPARK 10.0
#define LOAD 0.0
#define LONGEST_LAG 1.0

enum { CHARGE, SPARK_FACTOR, CHANNELS };

typedef struct {
    double volume, temperature, saturation_angle, angle_slope, angle_offset, max_flow;
    double efficiency[7];
    double pumping, angle_per_ratio, best_ratio, best_torque_angle, exponent, delay[CHANNELS];
    double torque_constant, friction, viscous, inertia;
} Parameters;

typedef struct {
    double pressure, speed;
} State;

/* A ring of samples: number k, taken at k steps, stands at k & mask. */
typedef struct {
    double *samples[CHANNELS], before[CHANNELS];
    long newest, mask;
    double step;
    int failed;
} History;

static double clamp(double value, double low, double high) { return value < low ? low : value > high ? high : value; }

static double air_mass(const Parameters *p, double pressure) {
    return pressure * p->volume / (GAS_CONSTANT * p->temperature);
}

static double cylinder_flow(const Parameters *p, State x) {
    const double *c = p->efficiency, mass = air_mass(p, x.pressure);
    double efficiency = (c[0] * x.speed + c[1]) * mass * mass + (c[2] * x.speed + c[3]) * mass + c[4] * x.speed + c[5];
    return p->pumping * efficiency * x.speed * mass;
}

static double throttle_flow(const Parameters *p, double angle, double pressure) {
    double ratio = clamp(pressure / AMBIENT_PRESSURE, 0.0, 1.0);
    double corrected = fmin(p->angle_slope * clamp(angle, 0.0, 90.0) + p->angle_offset, 90.0);
    return p->max_flow * (1.0 - exp(PRESSURE_EXPONENT * (ratio - 1.0))) * (1.0 - cos(corrected * RADIANS));
}

static void emit(const Parameters *p, State x, double z[CHANNELS]) {
    double angle = clamp(p->angle_per_ratio * (AIR_FUEL_RATIO - p->best_ratio), -180.0, 180.0);
    z[CHARGE] = cylinder_flow(p, x) * fmax(cos(angle * RADIANS), 0.0) / x.speed;
    z[SPARK_FACTOR] = pow(cos(SPARK * RADIANS), p->exponent);
}

static double read_back(History *h, int channel, double time) {
    double place = time / h->step;
    if (place < 0.0) return h->before[channel];
    long first = (long)place - 1;
    if (first > h->newest - 3) first = h->newest - 3;
    if (first < 0) first = 0;
    if (place > (double)h->newest || h->newest < 3 || h->newest - first > h->mask) {
        h->failed = 1;
        return h->before[channel];
    }
    const double *z = h->samples[channel];
    double s = place - (double)first, a = s - 1.0, b = s - 2.0, c = s - 3.0;
    double near = s * c * (z[(first + 1) & h->mask] * b - z[(first + 2) & h->mask] * a) / 2.0;
    return near + a * b * (z[(first + 3) & h->mask] * s - z[first & h->mask] * c) / 6.0;
}

static State rate(const Parameters *p, History *h, State x, double angle, double time) {
    double charge = read_back(h, CHARGE, time - p->delay[CHARGE] / x.speed);
    double spark_factor = read_back(h, SPARK_FACTOR, time - p->delay[SPARK_FACTOR] / x.speed);
    double torque = p->torque_constant * charge * spark_factor - (p->friction + p->viscous * x.speed) - LOAD;
    double filling = throttle_flow(p, angle, x.pressure) - cylinder_flow(p, x);
    return (State){GAS_CONSTANT * p->temperature / p->volume * filling, torque / p->inertia};
}

static State moved(State x, State k, double step) {
    return (State){x.pressure + step * k.pressure, x.speed + step * k.speed};
}

static void keep(const Parameters *p, History *h, State x, long number) {
    double z[CHANNELS];
    emit(p, x, z);
    for (int i = 0; i < CHANNELS; i++) h->samples[i][number & h->mask] = z[i];
    h->newest = number;
}

static State advance(const Parameters *p, History *h, State x, const double drive[3], long number) {
    double step = h->step, time = (double)number * step, half = time + 0.5 * step, end = (double)(number + 1) * step;
    double middle = drive[0] + drive[1] * sin(drive[2] * half);
    State k1 = rate(p, h, x, drive[0] + drive[1] * sin(drive[2] * time), time);
    State k2 = rate(p, h, moved(x, k1, 0.5 * step), middle, half);
    State k3 = rate(p, h, moved(x, k2, 0.5 * step), middle, half);
    State k4 = rate(p, h, moved(x, k3, step), drive[0] + drive[1] * sin(drive[2] * end), end);
    return (State){x.pressure + step / 6.0 * (k1.pressure + 2.0 * (k2.pressure + k3.pressure) + k4.pressure),
                   x.speed + step / 6.0 * (k1.speed + 2.0 * (k2.speed + k3.speed) + k4.speed)};
}

static int read_parameters(const char *path, Parameters *p) {
    double values[COUNT];
    char word[4096];
    int count = 0;
    FILE *file = fopen(path, "r");
    if (!file) return 0;
    while (count < COUNT && fscanf(file, " %4095[^ ,\t\r\n]", word) == 1) {
        if (word[0] == '#' || word[0] == '%') {
            (void)!fscanf(file, "%*[^\n]");
        } else {
            char *end;
            values[count++] = strtod(word, &end);
            if (*end) count = COUNT + 1;
        }
        (void)!fscanf(file, "%*1[,]");
    }
    fclose(file);
    if (count != COUNT) return 0;
    memcpy(p, values, sizeof values);
    return 1;
}

static int open_history(History *h, const Parameters *p, State x, double step) {
    long size = 16;
    while ((double)size * step < LONGEST_LAG + 8.0 * step) size *= 2;
    h->mask = size - 1;
    h->step = step;
    h->failed = 0;
    emit(p, x, h->before);
    for (int i = 0; i < CHANNELS; i++) {
        h->samples[i] = malloc((size_t)size * sizeof(double));
        if (!h->samples[i]) return 0;
    }
    keep(p, h, x, 0);
    return 1;
}

int main(int count, char **words) {
    _Static_assert(sizeof(Parameters) == COUNT * sizeof(double), "the parameters are the vector");
    Parameters p;
    History h;
    double numbers[7];
    char *end;
    if (count != 9 || !read_parameters(words[1], &p)) {
        fprintf(stderr, "usage: engine_rk4 VECTOR STEP STEPS THROTTLE AMPLITUDE OMEGA PRESSURE SPEED, VECTOR a file of 24 numbers\n");
        return 2;
    }
    for (int i = 0; i < 7; i++) {
        numbers[i] = strtod(words[i + 2], &end);
        if (*end || !isfinite(numbers[i])) {
            fprintf(stderr, "%s is no number\n", words[i + 2]);
            return 2;
        }
    }
    double step = numbers[0];
    const double *drive = numbers + 2;
    long steps = (long)numbers[1];
    State x = {numbers[5], numbers[6]};
    if (!(step > 1e-9) || steps < 1 || !(x.speed > 0.0) || !open_history(&h, &p, x, step)) {
        fprintf(stderr, "STEP must be above 1e-9, STEPS at least 1 and SPEED above 0\n");
        return 2;
    }
    struct timespec begin, done;
    long number = 0;
    clock_gettime(CLOCK_MONOTONIC, &begin);
    for (; number < steps && !h.failed && x.speed > 0.0; number++) {
        x = advance(&p, &h, x, drive, number);
        keep(&p, &h, x, number + 1);
    }
    clock_gettime(CLOCK_MONOTONIC, &done);
    if (h.failed || !(x.speed > 0.0)) {
        fprintf(stderr, "stopped at t = %g s, speed %g rad/s: a lag is no longer than three steps or longer than %g s, or the engine stalled\n",
                (double)number * step, x.speed, LONGEST_LAG);
        return 1;
    }
    double elapsed = (double)(done.tv_sec - begin.tv_sec) * 1e9 + (double)(done.tv_nsec - begin.tv_nsec);
    printf("%.17g %.17g %.17g %.17g\n", (double)number * step, x.pressure, x.speed, elapsed / (double)number);
    for (int i = 0; i < CHANNELS; i++) free(h.samples[i]);
    return 0;
}
