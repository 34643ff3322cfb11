/*
 * The lab's kernels as a competent user would write them in C: one lane (joint, recording, configuration) after
 * another in scalar code, all lanes shared out over POSIX threads. Parameter-only expressions are hoisted; loops
 * over the d x d covariance and over the taps of a window are written plainly, for the compiler to vectorise.
 *
 *   gcc -std=gnu99 -O3 -march=native -ffast-math -shared -fPIC -pthread baseline.c -o baseline.so -lm
 *
 * `vsajax bench --against c` builds it, checks that its results are those of vsajax, and times both. The
 * equations are those of the docstrings in vsajax/; arrays are (lane, time), SI units, double precision.
 */
#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

/* ---- lanes over threads ------------------------------------------------------------------------------------ */

#define MAX_THREADS 256

typedef int (*lane_function)(long lane, const void *job);

struct crew {
    lane_function run;
    const void *job;
    long lanes;
    long next;
    int failed;
};

static void *work(void *argument)
{
    struct crew *crew = argument;
    for (;;) {
        long lane = __atomic_fetch_add(&crew->next, 1, __ATOMIC_RELAXED);
        if (lane >= crew->lanes)
            return NULL;
        if (crew->run(lane, crew->job))
            __atomic_store_n(&crew->failed, 1, __ATOMIC_RELAXED);
    }
}

/* Returns 0, or 1 where memory ran out. */
static int share_out(lane_function run, const void *job, long lanes, int threads)
{
    struct crew crew = {run, job, lanes, 0, 0};
    pthread_t helpers[MAX_THREADS];
    int started = 0;
    if (threads > MAX_THREADS)
        threads = MAX_THREADS;
    while (started < threads - 1 && pthread_create(&helpers[started], NULL, work, &crew) == 0)
        started++;
    work(&crew);
    for (int i = 0; i < started; i++)
        pthread_join(helpers[i], NULL);
    return crew.failed;
}

/* ---- joints: damping-exact splitting ------------------------------------------------------------------------ */

struct response {
    double decay, gain, travel;
};

/* The exact response of x' = v, v' = -rate v + a over a step with constant a. */
static struct response damped_response(double rate, double step)
{
    double x = rate * step, first, second;
    if (x < 1e-2) {
        second = 0.5 - x * (1.0 / 6 - x * (1.0 / 24 - x * (1.0 / 120 - x * (1.0 / 720 - x / 5040))));
        first = 1.0 - x * second;
    } else {
        first = -expm1(-x) / x;
        second = (x + expm1(-x)) / (x * x);
    }
    return (struct response){exp(-x), step * first, step * step * second};
}

struct awas_joint {
    double link_inertia, link_damping;
    double motor_inertia, motor_damping, motor_gear;
    double setpoint_inertia, setpoint_damping, setpoint_gear;
    double spring_rate, arm, pitch;
    double setpoint_start, start;
};

struct plant_job {
    long samples;
    long substeps;
    double step;
    const double *torque1, *torque2; /* (time, substep), in the middle of every step */
    const void *joints;
    double *result; /* (lane, 2): mean stiffness, last link position */
};

static int awas_lane(long lane, const void *argument)
{
    const struct plant_job *job = argument;
    const struct awas_joint *joint = (const struct awas_joint *)job->joints + lane;
    const double half = 0.5 * job->step;
    const struct response of_q = damped_response(joint->link_damping / joint->link_inertia, job->step);
    const struct response of_m = damped_response(joint->motor_damping / joint->motor_inertia, job->step);
    const struct response of_s = damped_response(joint->setpoint_damping / joint->setpoint_inertia, job->step);
    const double per_link = 1.0 / joint->link_inertia;
    const double per_motor = 1.0 / (joint->motor_inertia * joint->motor_gear);
    const double per_setpoint = 1.0 / (joint->setpoint_inertia * joint->setpoint_gear);
    const double elastic_per_motor = per_motor / joint->motor_gear;
    const double coupling_per_setpoint = per_setpoint / joint->setpoint_gear;
    const double rate = 2.0 * joint->spring_rate, arm = joint->arm, pitch = joint->pitch;
    double q = joint->start, m = joint->start, s = joint->setpoint_start, vq = 0.0, vm = 0.0, vs = 0.0;
    double total = 0.0;
    for (long k = 0;; k++) {
        double sine = sin(q - m), lever = arm + pitch * s;
        total += rate * lever * lever * (1.0 - 2.0 * sine * sine);
        if (k == job->samples - 1)
            break;
        const double *torque1 = job->torque1 + k * job->substeps, *torque2 = job->torque2 + k * job->substeps;
        for (long i = 0; i < job->substeps; i++) {
            sine = sin((q + half * vq) - (m + half * vm));
            lever = arm + pitch * (s + half * vs);
            double pull = rate * lever * sine;
            double elastic = pull * lever * sqrt(1.0 - sine * sine), coupling = pitch * pull * sine;
            double aq = -elastic * per_link;
            double am = torque1[i] * per_motor + elastic * elastic_per_motor;
            double as = torque2[i] * per_setpoint - coupling * coupling_per_setpoint;
            q += of_q.gain * vq + of_q.travel * aq;
            m += of_m.gain * vm + of_m.travel * am;
            s += of_s.gain * vs + of_s.travel * as;
            vq = of_q.decay * vq + of_q.gain * aq;
            vm = of_m.decay * vm + of_m.gain * am;
            vs = of_s.decay * vs + of_s.gain * as;
        }
    }
    job->result[2 * lane] = total / job->samples;
    job->result[2 * lane + 1] = q;
    return 0;
}

int awas_plant(long lanes, int threads, long samples, long substeps, double step, const double *motor,
               const double *setpoint_motor, const double *joints, double *result)
{
    struct plant_job job = {samples, substeps, step, motor, setpoint_motor, joints, result};
    return share_out(awas_lane, &job, lanes, threads);
}

struct antagonistic_joint {
    double link_inertia, link_damping;
    double inertia1, damping1, gear1;
    double inertia2, damping2, gear2;
    double linear1, cubic1, linear2, cubic2;
};

static int antagonistic_lane(long lane, const void *argument)
{
    const struct plant_job *job = argument;
    const struct antagonistic_joint *joint = (const struct antagonistic_joint *)job->joints + lane;
    const double half = 0.5 * job->step;
    const struct response of_q = damped_response(joint->link_damping / joint->link_inertia, job->step);
    const struct response of_1 = damped_response(joint->damping1 / joint->inertia1, job->step);
    const struct response of_2 = damped_response(joint->damping2 / joint->inertia2, job->step);
    const double per_link = 1.0 / joint->link_inertia;
    const double per_1 = 1.0 / (joint->inertia1 * joint->gear1);
    const double per_2 = 1.0 / (joint->inertia2 * joint->gear2);
    const double pull_per_1 = per_1 / joint->gear1, pull_per_2 = per_2 / joint->gear2;
    const double linear1 = joint->linear1, cubic1 = joint->cubic1, linear2 = joint->linear2, cubic2 = joint->cubic2;
    double q = 0.0, m1 = 0.0, m2 = 0.0, vq = 0.0, v1 = 0.0, v2 = 0.0, total = 0.0;
    for (long k = 0;; k++) {
        double d1 = q - m1, d2 = q - m2;
        total += linear1 + 3.0 * cubic1 * d1 * d1 + linear2 + 3.0 * cubic2 * d2 * d2;
        if (k == job->samples - 1)
            break;
        const double *torque1 = job->torque1 + k * job->substeps, *torque2 = job->torque2 + k * job->substeps;
        for (long i = 0; i < job->substeps; i++) {
            double middle = q + half * vq;
            d1 = middle - (m1 + half * v1);
            d2 = middle - (m2 + half * v2);
            double pull1 = d1 * (linear1 + cubic1 * d1 * d1), pull2 = d2 * (linear2 + cubic2 * d2 * d2);
            double aq = -(pull1 + pull2) * per_link;
            double a1 = torque1[i] * per_1 + pull1 * pull_per_1;
            double a2 = torque2[i] * per_2 + pull2 * pull_per_2;
            q += of_q.gain * vq + of_q.travel * aq;
            m1 += of_1.gain * v1 + of_1.travel * a1;
            m2 += of_2.gain * v2 + of_2.travel * a2;
            vq = of_q.decay * vq + of_q.gain * aq;
            v1 = of_1.decay * v1 + of_1.gain * a1;
            v2 = of_2.decay * v2 + of_2.gain * a2;
        }
    }
    job->result[2 * lane] = total / job->samples;
    job->result[2 * lane + 1] = q;
    return 0;
}

int antagonistic_plant(long lanes, int threads, long samples, long substeps, double step, const double *motor1,
                       const double *motor2, const double *joints, double *result)
{
    struct plant_job job = {samples, substeps, step, motor1, motor2, joints, result};
    return share_out(antagonistic_lane, &job, lanes, threads);
}

/* ---- shared by the estimators ------------------------------------------------------------------------------- */

struct kalman {
    double position, velocity, position_variance, covariance, velocity_variance;
};

static inline struct kalman predict_and_correct(struct kalman s, double reading, double dt,
                                                double acceleration_variance, double reading_variance)
{
    double half_square = 0.5 * dt * dt;
    double position = s.position + dt * s.velocity;
    double cross = s.covariance + dt * s.velocity_variance;
    double position_variance =
        s.position_variance + dt * (s.covariance + cross) + acceleration_variance * half_square * half_square;
    cross += acceleration_variance * half_square * dt;
    double velocity_variance = s.velocity_variance + acceleration_variance * dt * dt;
    double precision = 1.0 / (position_variance + reading_variance);
    double position_gain = position_variance * precision, velocity_gain = cross * precision;
    double innovation = reading - position;
    return (struct kalman){position + position_gain * innovation, s.velocity + velocity_gain * innovation,
                           position_variance * (1.0 - position_gain), cross * (1.0 - position_gain),
                           velocity_variance - velocity_gain * cross};
}

/*
 * One sample of recursive least squares with d features, a multiple of 3. P is symmetric and kept whole, its rows
 * padded with zeros to whole vectors of `row` numbers; three rows at a time keep the sums in registers. The
 * symmetric half alone costs twice as much: gcc does not vectorise its short uneven rows.
 */
static inline __attribute__((always_inline)) void least_squares(int d, int row, double *restrict P,
                                                                double *restrict coefficients,
                                                                const double *restrict features, double target)
{
    double column[row];
    memset(column, 0, sizeof column);
    for (int i = 0; i < d; i += 3)
        for (int j = 0; j < row; j++)
            column[j] += features[i] * P[i * row + j] + features[i + 1] * P[(i + 1) * row + j] +
                         features[i + 2] * P[(i + 2) * row + j];
    double leverage = 0.0, innovation = target;
    for (int j = 0; j < d; j++) {
        leverage += features[j] * column[j];
        innovation -= features[j] * coefficients[j];
    }
    double gain = 1.0 / (1.0 + leverage);
    for (int i = 0; i < d; i++)
        coefficients[i] += gain * column[i] * innovation;
    for (int i = 0; i < d; i++) {
        double scaled = gain * column[i];
        for (int j = 0; j < row; j++)
            P[i * row + j] -= scaled * column[j];
    }
}

/* ---- serial joint: modified kinematic Kalman filters, residual torque, RLS with d = 18 ---------------------- */

#define TERMS 6
#define LEVERS 3
#define FEATURES (TERMS * LEVERS)
#define ROW 20

struct serial_settings {
    double slow_variance, sharpness, counts_per_revolution, start_position_variance, start_velocity_variance;
    double motor_inertia, motor_damping, gear_ratio;
    double deflection_scale, setpoint_origin, setpoint_scale; /* the latter two in the basis' unit */
};

struct serial_parameters {
    double observer_gain, acceleration_variance, fast_variance, prior_scale;
};

struct serial_recording {
    const double *link, *motor, *setpoint, *torque, *stiffness;
};

static inline struct kalman modified_kalman(struct kalman state, double reading, double dt, double per_count,
                                            const struct serial_settings *settings,
                                            const struct serial_parameters *own)
{
    double counts = fabs(state.velocity) * dt * per_count;
    double spread = settings->slow_variance - own->fast_variance;
    double variance = spread / (1.0 + exp((counts - 1.0) * settings->sharpness)) + own->fast_variance;
    return predict_and_correct(state, reading, dt, own->acceleration_variance, variance);
}

/* Returns the MSREP [%]. With `is_raw` the deflection is that of the readings, else of both filters. */
static inline __attribute__((always_inline)) double
serial_estimator(const struct serial_settings *settings, const struct serial_parameters *own, long samples,
                 const double *dt, struct serial_recording recording, int is_raw)
{
    double P[FEATURES * ROW] __attribute__((aligned(64))) = {0};
    double coefficients[FEATURES] = {0}, features[FEATURES], slopes[FEATURES];
    for (int i = 0; i < FEATURES; i++)
        P[i * ROW + i] = own->prior_scale;
    const double per_count = settings->counts_per_revolution / (2.0 * M_PI);
    const double per_scale = 1.0 / settings->deflection_scale, gear = settings->gear_ratio;
    struct kalman motor = {recording.motor[0], 0.0, settings->start_position_variance, 0.0,
                           settings->start_velocity_variance};
    struct kalman link = motor;
    link.position = recording.link[0];
    double residual = 0.0, impulse = 0.0, last_torque = recording.torque[0];
    double last_balance = gear * settings->motor_damping * recording.motor[0];
    double squares = 0.0;
    for (long k = 0; k < samples; k++) {
        motor = modified_kalman(motor, recording.motor[k], dt[k], per_count, settings, own);
        double deflection = recording.link[k] - recording.motor[k];
        if (!is_raw) {
            link = modified_kalman(link, recording.link[k], dt[k], per_count, settings, own);
            deflection = link.position - motor.position;
        }

        impulse += 0.5 * (recording.torque[k] + last_torque) * dt[k];
        last_torque = recording.torque[k];
        double balance =
            gear * (settings->motor_inertia * motor.velocity + settings->motor_damping * motor.position) - impulse;
        double gain_step = own->observer_gain * dt[k];
        residual = ((2.0 - gain_step) * residual + 2.0 * own->observer_gain * (balance - last_balance)) /
                   (2.0 + gain_step);
        last_balance = balance;

        double x = deflection * per_scale, square = x * x, even = 1.0, outer = 1.0;
        double lever = settings->setpoint_origin + settings->setpoint_scale * recording.setpoint[k];
        for (int i = 0; i < TERMS; i++) {
            features[i] = even * x;
            slopes[i] = (2 * i + 1) * even * per_scale;
            even *= square;
        }
        for (int j = 1; j < LEVERS; j++) {
            outer *= lever;
            for (int i = 0; i < TERMS; i++) {
                features[j * TERMS + i] = outer * features[i];
                slopes[j * TERMS + i] = outer * slopes[i];
            }
        }
        least_squares(FEATURES, ROW, P, coefficients, features, gear * residual);

        double stiffness = 0.0;
        for (int i = 0; i < FEATURES; i++)
            stiffness += slopes[i] * coefficients[i];
        double relative = (recording.stiffness[k] - stiffness) / recording.stiffness[k];
        squares += relative * relative;
    }
    return 100.0 * squares / (samples - 1);
}

struct serial_job {
    long samples;
    const double *dt;
    struct serial_recording recordings;
    const struct serial_settings *settings;
    const struct serial_parameters *parameters;
    double *result;
};

static int serial_lane(long lane, const void *argument)
{
    const struct serial_job *job = argument;
    long at = lane * job->samples;
    struct serial_recording own = {job->recordings.link + at, job->recordings.motor + at,
                                   job->recordings.setpoint + at, job->recordings.torque + at,
                                   job->recordings.stiffness + at};
    job->result[lane] =
        serial_estimator(job->settings, job->parameters + lane, job->samples, job->dt, own, 0);
    return 0;
}

int serial(long lanes, int threads, long samples, const double *dt, const double *link, const double *motor,
           const double *setpoint, const double *torque, const double *stiffness, const double *settings,
           const double *parameters, double *result)
{
    struct serial_job job = {samples, dt, {link, motor, setpoint, torque, stiffness},
                             (const struct serial_settings *)settings,
                             (const struct serial_parameters *)parameters, result};
    return share_out(serial_lane, &job, lanes, threads);
}

/* ---- sweep: the estimator in nested loops over prior scale, observer gain and noise ------------------------- */

struct sweep_job {
    long samples, gains, draws;
    const double *dt;
    struct serial_recording recording; /* torque: (draw, time) */
    const struct serial_settings *settings;
    struct serial_parameters base;
    const double *prior_scales, *observer_gains;
    double *result; /* (prior scale, observer gain, draw) */
};

static int sweep_lane(long lane, const void *argument)
{
    const struct sweep_job *job = argument;
    struct serial_parameters own = job->base;
    own.prior_scale = job->prior_scales[lane / (job->gains * job->draws)];
    own.observer_gain = job->observer_gains[lane / job->draws % job->gains];
    struct serial_recording recording = job->recording;
    recording.torque += lane % job->draws * job->samples;
    job->result[lane] = serial_estimator(job->settings, &own, job->samples, job->dt, recording, 1);
    return 0;
}

/* The loops over `scales`, `gains` and `draws` are one loop, so that the threads share it out evenly. */
int sweep(long scales, long gains, long draws, int threads, long samples, const double *dt, const double *link,
          const double *motor, const double *setpoint, const double *torques, const double *stiffness,
          const double *settings, const double *base, const double *prior_scales, const double *observer_gains,
          double *result)
{
    struct sweep_job job = {samples, gains, draws, dt, {link, motor, setpoint, torques, stiffness},
                            (const struct serial_settings *)settings, *(const struct serial_parameters *)base,
                            prior_scales, observer_gains, result};
    return share_out(sweep_lane, &job, scales * gains * draws, threads);
}

/* ---- antagonistic joint: algebraic observer by direct convolution, RLS with d = 3 --------------------------- */

#define ORDER 3
#define ORDER_ROW 4

struct algebraic_settings {
    double gear_ratio, deflection_scale, prior_scale;
    double samples_per_window; /* T / T_s */
    double row_weight;         /* sqrt(T_s / T) */
    double acceleration_variance, reading_variance, start_position_variance, start_velocity_variance;
    double stiffness_floor;
};

struct algebraic_job {
    long samples, taps;
    const double *dt, *on_position, *on_torque; /* taps, oldest sample first */
    const double *link, *motors[2], *torques[2], *stiffness;
    const struct algebraic_settings *settings;
    double *result;
};

/* Adds the stiffness of one side to `total`. */
static void algebraic_side(const struct algebraic_job *job, const double *link, const double *motor,
                           const double *torque, double *scratch, double *total)
{
    const struct algebraic_settings *settings = job->settings;
    const long samples = job->samples, taps = job->taps;
    double *restrict position = scratch, *restrict drive = position + samples, *restrict f1 = drive + samples,
                     *restrict f2 = f1 + samples, *restrict f3 = f2 + samples;
    const double per_scale = 1.0 / settings->deflection_scale, x0 = (link[0] - motor[0]) * per_scale;
    for (long k = 0; k < samples; k++) {
        double x = (link[k] - motor[k]) * per_scale;
        position[k] = motor[k] - motor[0];
        drive[k] = settings->gear_ratio * (torque[k] - torque[0]);
        f1[k] = x - x0;
        f2[k] = (x * x - x0 * x0) / 2.0;
        f3[k] = (x * x * x - x0 * x0 * x0) / 6.0;
    }
    double P[ORDER * ORDER_ROW] = {0}, coefficients[ORDER] = {0};
    for (int i = 0; i < ORDER; i++)
        P[i * ORDER_ROW + i] = settings->prior_scale;
    struct kalman motor_filter = {motor[0], 0.0, settings->start_position_variance, 0.0,
                                  settings->start_velocity_variance};
    struct kalman link_filter = motor_filter;
    link_filter.position = link[0];
    for (long k = 0; k < samples; k++) {
        motor_filter = predict_and_correct(motor_filter, motor[k], job->dt[k], settings->acceleration_variance,
                                           settings->reading_variance);
        link_filter = predict_and_correct(link_filter, link[k], job->dt[k], settings->acceleration_variance,
                                          settings->reading_variance);
        double share = fmin(fmax(k + 1 - settings->samples_per_window, 0.0), 1.0);
        if (share > 0.0) {
            long available = k + 1 < taps ? k + 1 : taps, start = k + 1 - available;
            const double *restrict c = job->on_position + (taps - available);
            const double *restrict g = job->on_torque + (taps - available);
            double target = 0.0, b1 = 0.0, b2 = 0.0, b3 = 0.0;
            for (long m = 0; m < available; m++) {
                target += c[m] * position[start + m] + g[m] * drive[start + m];
                b1 += g[m] * f1[start + m];
                b2 += g[m] * f2[start + m];
                b3 += g[m] * f3[start + m];
            }
            double weight = sqrt(share) * settings->row_weight;
            double features[ORDER] = {-weight * b1, -weight * b2, -weight * b3};
            least_squares(ORDER, ORDER_ROW, P, coefficients, features, weight * target);
        }
        double x = (link_filter.position - motor_filter.position) * per_scale;
        total[k] += (coefficients[0] + x * (coefficients[1] + 0.5 * x * coefficients[2])) * per_scale;
    }
}

static int algebraic_lane(long lane, const void *argument)
{
    const struct algebraic_job *job = argument;
    long at = lane * job->samples;
    double *scratch = calloc(6 * job->samples, sizeof *scratch);
    if (!scratch)
        return 1;
    double *total = scratch + 5 * job->samples;
    for (int side = 0; side < 2; side++)
        algebraic_side(job, job->link + at, job->motors[side] + at, job->torques[side] + at, scratch, total);
    double squares = 0.0;
    long counted = 0;
    for (long k = 0; k < job->samples; k++) {
        double stiffness = job->stiffness[at + k];
        if (fabs(stiffness) <= job->settings->stiffness_floor)
            continue;
        double relative = (stiffness - total[k]) / stiffness;
        squares += relative * relative;
        counted++;
    }
    job->result[lane] = 100.0 * squares / (counted - 1);
    free(scratch);
    return 0;
}

int algebraic(long lanes, int threads, long samples, long taps, const double *dt, const double *on_position,
              const double *on_torque, const double *link, const double *motor1, const double *motor2,
              const double *torque1, const double *torque2, const double *stiffness, const double *settings,
              double *result)
{
    struct algebraic_job job = {samples, taps, dt, on_position, on_torque, link, {motor1, motor2},
                                {torque1, torque2}, stiffness, (const struct algebraic_settings *)settings, result};
    return share_out(algebraic_lane, &job, lanes, threads);
}

/* ---- the machine's floating-point peak ---------------------------------------------------------------------- */

#ifdef __AVX512F__
#define WIDTH 8
#else
#define WIDTH 4
#endif
#define CHAINS 12

typedef double vector __attribute__((vector_size(WIDTH * sizeof(double))));

struct peak_job {
    long rounds;
    double *result;
};

/* Independent chains hide the latency of the fused multiply-add: 2 * CHAINS * WIDTH flops a round. */
static int peak_lane(long lane, const void *argument)
{
    const struct peak_job *job = argument;
    vector chain[CHAINS];
    vector factor, addend;
    for (int j = 0; j < WIDTH; j++) {
        factor[j] = 1.0 - 1e-9 * (double)(lane + 1);
        addend[j] = 1e-9;
    }
    for (int i = 0; i < CHAINS; i++)
        chain[i] = addend * (double)(i + 1);
    for (long round = 0; round < job->rounds; round++)
        for (int i = 0; i < CHAINS; i++)
            chain[i] = chain[i] * factor + addend;
    double total = 0.0;
    for (int i = 0; i < CHAINS; i++)
        for (int j = 0; j < WIDTH; j++)
            total += chain[i][j];
    job->result[lane] = total;
    return 0;
}

int flops_per_round(void)
{
    return 2 * CHAINS * WIDTH;
}

int peak(long lanes, int threads, long rounds, double *result)
{
    struct peak_job job = {rounds, result};
    return share_out(peak_lane, &job, lanes, threads);
}
