/* What board.c and board_inputs.c share. */
#ifndef BOARD_H
#define BOARD_H

#include <simavr/sim_avr.h>

enum { FREQUENCY = 16000000 };

extern avr_t *avr;

double seconds(void); /* simulated */
void fail(const char *what);
void log_line(int channel, int count);

/* Settings of the inputs: see board.c. */
extern unsigned seed;
extern int ads_count;
extern double ads_stop;
void read_points(const char *path);

void connect_inputs(void);

#endif
