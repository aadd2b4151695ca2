/* What nacred and its clients call things on the D-Bus; docs/daemon.md describes the interface. */
#ifndef RIG_DAEMON_NAMES_H
#define RIG_DAEMON_NAMES_H

#define STATION_SERVICE   "org.nacre.Station1"
#define STATION_INTERFACE "org.nacre.Station1"
#define STATION_OBJECT    "/org/nacre/Station1"

#define STATION_ERROR_BUSY            "org.nacre.Error.Busy"
#define STATION_ERROR_BAD_NAME        "org.nacre.Error.BadName"
#define STATION_ERROR_BAD_PLAN        "org.nacre.Error.BadPlan"
#define STATION_ERROR_NO_SUCH_SESSION "org.nacre.Error.NoSuchSession"
#define STATION_ERROR_SESSION_EXISTS  "org.nacre.Error.SessionExists"
#define STATION_ERROR_NOTHING_TO_DO   "org.nacre.Error.NothingToDo"
#define STATION_ERROR_FAILED          "org.nacre.Error.Failed"

/* What the messages of a plan begin with, which came as a text without a name: "plan:3:5: ...". */
#define STATION_PLAN_NAME "plan"

#endif
